"""Fewer and cleaner points: statistical denoising and the three ways of down-sampling [Zhang, Sec.
III-A, III-B].

Every function tells which points to keep, so that normals, colours or pixels can be kept along with
them.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from breastscan.geometry.compiled import kernel

NEIGHBOURS = 15
"""Neighbourhood that the paper settles on [Zhang, Fig. 10]."""
CUBES = 16
"""Along the cloud's longest side, each of whose points are looked at together."""


def statistical_inliers(
    points: Float[np.ndarray, "n 3"], *, alpha: float = 2.0, k: int = NEIGHBOURS
) -> Bool[np.ndarray, "n"]:
    """Points whose mean distance to their `k` nearest is within `alpha` deviations of the cloud's
    mean [Zhang, Eq. 12].

    Points lying unusually close together are dropped as well as lonely ones, as the paper has it.
    """
    if alpha <= 0:
        raise ValueError(f"alpha must be positive, got {alpha}")
    if not 0 < k < len(points):
        raise ValueError(
            f"k must be from 1 to one less than the number of points, {len(points)}, got {k}"
        )
    distances, _ = KDTree(points).query(points, k=k + 1)  # the nearest point is the point itself
    mean_distance = distances[:, 1:].mean(axis=1)
    return np.abs(mean_distance - mean_distance.mean()) <= alpha * mean_distance.std()


def grid_sample(points: Float[np.ndarray, "n 3"], cell: float) -> Int[np.ndarray, "m"]:
    """Indices of one point in each occupied cube of edge `cell` [m]: the one nearest to the mean
    of its points.
    """
    if cell <= 0:
        raise ValueError(f"cell must be a positive length [m], got {cell}")
    _, cube = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    cube = cube.reshape(-1)
    counts = np.bincount(cube)
    means = np.stack(
        [np.bincount(cube, weights=points[:, axis]) / counts for axis in range(3)], axis=-1
    )
    order = np.lexsort((np.linalg.norm(points - means[cube], axis=1), cube))
    first_of_cube = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return np.sort(order[first_of_cube])


def uniform_sample(points: Float[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "count"]:
    """Indices of `count` points, each the farthest from those before it, beginning at the one
    farthest from the mean.

    Even, and fond of edges: the paper's choice.
    """
    _check_count(points, count)
    chosen = np.empty(count, np.int64)
    chosen[0] = np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))
    order, starts = _blocks(points)
    _farthest_points(points[order], order, starts, chosen)
    return chosen


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
    """
    _check_count(points, count)
    weights = variation + variation.mean() + np.finfo(float).tiny
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(len(points), count, replace=False, p=weights / weights.sum()))


def _check_count(points: Float[np.ndarray, "n 3"], count: int) -> None:
    if not 0 < count <= len(points):
        raise ValueError(
            f"count must be from 1 to the number of points, {len(points)}, got {count}"
        )


def _blocks(
    points: Float[np.ndarray, "n 3"],
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "b1"]]:
    """An order in which the points of one cube follow one another, and where each cube's begin and
    the last's end.
    """
    edge = np.ptp(points, axis=0).max() / CUBES
    cube = np.floor((points - points.min(axis=0)) / (edge or 1.0)) @ (CUBES + 1.0) ** np.arange(3)
    order = np.argsort(cube, kind="stable")
    starts = np.flatnonzero(np.diff(cube[order], prepend=-1.0))
    return order, np.append(starts, len(points))


@kernel
def _apart(low, high, p):
    """Square of the distance of a point from a box."""
    total = 0.0
    for axis in range(3):
        gap = max(low[axis] - p[axis], p[axis] - high[axis], 0.0)
        total += gap * gap
    return total


@kernel
def _chosen_too(points, first, end, p, squared):
    """Take the point p among the chosen for the points from `first` to `end`, and give the number
    of the one that is then farthest from all chosen.
    """
    farthest = first
    for k in range(first, end):
        dx = points[k, 0] - p[0]
        dy = points[k, 1] - p[1]
        dz = points[k, 2] - p[2]
        squared[k] = min(squared[k], dx * dx + dy * dy + dz * dz)
        if squared[k] > squared[farthest]:
            farthest = k
    return farthest


@kernel
def _farthest_points(points, order, starts, chosen):
    """Fill `chosen` after its first, of points in that `order`.

    A cube is looked into only if its box lies nearer to the last choice than its farthest point to
    all choices before.
    """
    cubes = starts.size - 1
    low, high = np.empty((cubes, 3)), np.empty((cubes, 3))
    for c in range(cubes):
        for axis in range(3):
            low[c, axis] = points[starts[c] : starts[c + 1], axis].min()
            high[c, axis] = points[starts[c] : starts[c + 1], axis].max()
    squared, greatest = np.full(order.size, np.inf), np.full(cubes, np.inf)
    farthest = starts[:-1].copy()
    last = points[np.argmax(order == chosen[0])]
    for i in range(1, chosen.size):
        best = 0
        for c in range(cubes):
            if _apart(low[c], high[c], last) < greatest[c]:
                farthest[c] = _chosen_too(points, starts[c], starts[c + 1], last, squared)
                greatest[c] = squared[farthest[c]]
            comes_first = order[farthest[c]] < order[farthest[best]]
            if greatest[c] > greatest[best] or (greatest[c] == greatest[best] and comes_first):
                best = c
        chosen[i] = order[farthest[best]]
        last = points[farthest[best]]
