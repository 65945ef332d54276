"""Fewer and cleaner points: statistical denoising and the three ways of down-sampling [Zhang, Sec.
III-A, III-B].

Every function tells which points to keep, so that normals, colours or pixels can be kept along with
them.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit
from scipy.spatial import KDTree

NEIGHBOURS = 15
"""Neighbourhood that the paper settles on [Zhang, Fig. 10]."""


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

    Even, and fond of edges: the paper's choice. The cost grows as n times `count`.
    """
    _check_count(points, count)
    return _farthest_points(np.ascontiguousarray(points), count)


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


@njit(cache=True)
@no_type_check
def _farthest_points(points, count):
    chosen = np.empty(count, np.int64)
    mean = points.sum(axis=0) / len(points)
    squared = ((points - mean) ** 2).sum(axis=1)
    chosen[0] = np.argmax(squared)
    squared[:] = np.inf
    for i in range(1, count):
        last = points[chosen[i - 1]]
        farthest = 0
        for j in range(len(points)):
            dx = points[j, 0] - last[0]
            dy = points[j, 1] - last[1]
            dz = points[j, 2] - last[2]
            squared[j] = min(squared[j], dx * dx + dy * dy + dz * dz)
            if squared[j] > squared[farthest]:
                farthest = j
        chosen[i] = farthest
    return chosen
