"""Fewer and cleaner points: statistical denoising and the three ways of down-sampling [Zhang, Sec.
III-A, III-B].

Every function tells which points to keep, so that normals, colours or pixels can be kept along with
them.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from breastscan.geometry.compiled import kernel
from breastscan.geometry.point_tree import (
    apart,
    nearest,
    point_tree,
    require_points,
    squared_distance,
)

NEIGHBOURS = 15
"""Neighbourhood that the paper settles on [Zhang, Fig. 10]."""
SAMPLING_LEAF = 64
"""Points that uniform sampling looks at together: some 100 each sample stands for."""
MOST_CELLS = 2**20
"""From the origin along an axis: three such numbers are told by one."""


def statistical_inliers(
    points: Float[np.ndarray, "n 3"], *, alpha: float = 2.0, k: int = NEIGHBOURS
) -> Bool[np.ndarray, "n"]:
    """Points whose mean distance to their `k` nearest is within `alpha` deviations of the cloud's
    mean [Zhang, Eq. 12].

    Points lying unusually close together are dropped as well as lonely ones, as the paper has it.

    Raises:
        ValueError: No more points than `k`, or one that is not finite.
    """
    require_points(points)
    if not alpha > 0:
        raise ValueError(f"alpha must be positive, got {alpha}")
    if not 0 < k < len(points):
        raise ValueError(
            f"k must be from 1 to one less than the number of points, {len(points)}, got {k}"
        )
    mean_distance = _mean_distances(point_tree(points), k)
    return np.abs(mean_distance - mean_distance.mean()) <= alpha * mean_distance.std()


def grid_sample(points: Float[np.ndarray, "n 3"], cell: float) -> Int[np.ndarray, "m"]:
    """Indices of one point in each occupied cube of edge `cell` [m]: the one nearest to the mean
    of its points.

    Raises:
        ValueError: No points, one that is not finite, or cubes too small for them.
    """
    require_points(points)
    if not cell > 0:
        raise ValueError(f"cell must be a positive length [m], got {cell}")
    if not np.abs(points).max() < MOST_CELLS * cell:
        raise ValueError(
            f"cell must be more than 1 / {MOST_CELLS} of the cloud's coordinates [m], got {cell}"
        )
    x, y, z = np.floor(points / cell).astype(np.int64).T + MOST_CELLS
    _, cube = np.unique((x * 2 * MOST_CELLS + y) * 2 * MOST_CELLS + z, return_inverse=True)
    counts = np.bincount(cube)
    means = np.stack(
        [np.bincount(cube, weights=points[:, axis]) / counts for axis in range(3)], axis=-1
    )
    order = np.lexsort((np.linalg.norm(points - means[cube], axis=1), cube))
    first_of_cube = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return np.sort(order[first_of_cube])


def uniform_sample(points: Float[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "count"]:
    """Indices of `count` points, each the farthest from those before it, beginning at the one
    farthest from the mean; of equally far ones the first.

    Even, and fond of edges: the paper's choice. No index comes twice: where fewer places are
    distinct than points are wanted, the rest are the first of the points left.

    Raises:
        ValueError: Fewer points than `count`, or one that is not finite.
    """
    require_points(points)
    _check_count(points, count)
    chosen = _farthest_points(point_tree(points, SAMPLING_LEAF), points.mean(axis=0), count)
    left = np.setdiff1d(np.arange(len(points)), chosen) if len(chosen) < count else chosen[:0]
    return np.append(chosen, left[: count - len(chosen)])


def geometric_sample(
    points: Float[np.ndarray, "n 3"],
    variation: Float[np.ndarray, "n"],
    count: int,
    *,
    seed: int = 0,
) -> Int[np.ndarray, "count"]:
    """Indices of `count` points drawn more densely where the surface bends.

    Args:
        points: The cloud [m].
        variation: Surface variation of each point, as `normals.surface_variation` has it.
        count: Number of points to keep.
        seed: Of the draw. The chance of a point grows with its variation; the flattest keep some.

    Raises:
        ValueError: Fewer points than `count`, one that is not finite, or variations that cannot
            be weights.
    """
    require_points(points)
    _check_count(points, count)
    wrong = np.sum(~((variation >= 0) & (variation < np.inf)))
    if wrong:
        raise ValueError(
            f"variations must be finite and not negative, {wrong} of {len(variation)} are not"
        )
    weights = variation + variation.mean() + np.finfo(float).tiny
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(len(points), count, replace=False, p=weights / weights.sum()))


def _check_count(points: Float[np.ndarray, "n 3"], count: int) -> None:
    if not 0 < count <= len(points):
        raise ValueError(
            f"count must be from 1 to the number of points, {len(points)}, got {count}"
        )


@kernel
def _mean_distances(tree, k):
    """Of each of the given points from its k nearest others [m]."""
    squared, found = np.empty(k + 1), np.empty(k + 1, np.int64)
    means = np.empty(tree.order.size)
    for i in range(means.size):
        nearest(tree, tree.points[i], squared, found)  # the point itself among them, at 0
        means[tree.order[i]] = np.sqrt(squared).sum() / k
    return means


@kernel
def _farthest_below(tree, node, p, squared):
    """Take a place among the chosen for a node's points, and give the one that is then farthest
    from all chosen; of equally far ones the one given first.
    """
    farthest, most = tree.first[node], -1.0
    for i in range(tree.first[node], tree.end[node]):
        distance = min(squared[i], squared_distance(tree, i, p))
        squared[i] = distance
        if distance > most or (distance == most and tree.order[i] < tree.order[farthest]):
            farthest, most = i, distance
    return farthest


@kernel
def _farther_child(tree, node, farthest, greatest):
    """The same from those of its children."""
    left, right = 2 * node, 2 * node + 1
    if greatest[left] == greatest[right]:
        comes_first = tree.order[farthest[left]] < tree.order[farthest[right]]
        return farthest[left] if comes_first else farthest[right]
    return farthest[left] if greatest[left] > greatest[right] else farthest[right]


@kernel
def _farthest_points(tree, mean, count):
    """As many of the given points as there are places for, at most `count`.

    A node is looked into only if its box lies nearer to the last choice than its farthest point to
    all choices before.
    """
    leaves = tree.first.size // 2
    squared, greatest = np.full(tree.order.size, np.inf), np.full(2 * leaves, np.inf)
    farthest, nodes = np.empty(2 * leaves, np.int64), np.ones(2 * leaves, np.int64)
    chosen = np.empty(count, np.int64)
    last = _farthest_below(tree, 1, mean, squared)
    squared[:] = np.inf
    for i in range(count):
        if greatest[1] == 0.0:
            return chosen[:i]
        chosen[i] = tree.order[last]
        p = tree.points[last]
        found, seen = 1, 0
        while seen < found:
            child = 2 * nodes[seen]
            seen += 1
            for node in range(child, min(child + 2, 2 * leaves)):  # none of a leaf
                if apart(tree, node, p) < greatest[node]:
                    nodes[found] = node
                    found += 1
        for k in range(found - 1, -1, -1):  # children before their parents
            node = nodes[k]
            if node < leaves:
                best = _farther_child(tree, node, farthest, greatest)
            else:
                best = _farthest_below(tree, node, p, squared)
            farthest[node], greatest[node] = best, squared[best]
        last = farthest[1]
    return chosen
