"""Surface normals from the spread of each point's neighbourhood [Zhang, Eqs. 13-15]."""

import numpy as np
from jaxtyping import Float

from breastscan.geometry.compiled import kernel
from breastscan.geometry.point_tree import (
    DEPTH,
    apart,
    nearest,
    point_tree,
    reach,
    require_points,
    squared_distance,
)
from breastscan.geometry.symmetric import eigh3

RADIUS = 6e-3
"""Neighbourhood [m]: depth noise of .35 mm at .8 mm pitch then tilts a normal by 1 degree."""
FEWEST = 3
"""Points that define a plane."""
THIN = 1e-12
"""Of the largest eigenvalue, below which the second is rounding: the points lie in one line."""

SCATTER = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])
"""Where the moments of some points hold these about their centroid, after number and centroid."""


def estimate_normals(
    points: Float[np.ndarray, "n 3"],
    *,
    at: Float[np.ndarray, "m 3"] | None = None,
    radius: float = RADIUS,
    k: int | None = None,
) -> Float[np.ndarray, "m 3"]:
    """Unit normals in L, towards the camera at L's origin; NaN where fewer than three points are
    near, or all that are lie in one line.

    Args:
        points: The cloud in L [m].
        at: Where to estimate, in L [m]; at every point of the cloud by default.
        radius: Points no farther than this count as neighbours [m].
        k: Use this many nearest points instead, at whatever distance.

    Raises:
        ValueError: Fewer than three points, no place to estimate at, one of them that is not
            finite, or neighbourhoods that cannot define a plane.
    """
    covariances, counts = _covariances(points, at, radius, k)
    # the eigenvector of the smallest eigenvalue [Zhang, Eq. 14]
    spread, axes = eigh3(covariances)
    normals = axes[..., 0]
    # v = -p, v . n > 0 [Zhang, Eq. 15]
    away = np.sum(normals * (points if at is None else at), axis=-1) > 0.0
    unknown = (counts < FEWEST) | (spread[:, 1] <= THIN * spread[:, 2])
    return np.where(unknown[:, None], np.nan, np.where(away[:, None], -normals, normals))


def surface_variation(
    points: Float[np.ndarray, "n 3"], *, radius: float = RADIUS, k: int | None = None
) -> Float[np.ndarray, "n"]:
    """Fraction of the neighbourhood's spread that lies across the surface: 0 on a plane, in a line
    or in one place, growing as the surface bends.

    Raises:
        ValueError: As `estimate_normals`.
    """
    covariances, _ = _covariances(points, None, radius, k)
    spread, _ = eigh3(covariances)
    return np.maximum(spread[:, 0], 0.0) / np.maximum(spread.sum(axis=1), np.finfo(float).tiny)


def _covariances(
    points: Float[np.ndarray, "n 3"],
    at: Float[np.ndarray, "m 3"] | None,
    radius: float,
    k: int | None,
) -> tuple[Float[np.ndarray, "m 3 3"], np.ndarray]:
    """Covariance of each neighbourhood about its own centroid [Zhang, Eq. 13], and how many points
    it has.
    """
    require_points(points, FEWEST)
    if at is not None:
        require_points(at)
    if k is not None and not FEWEST <= k <= len(points):
        raise ValueError(f"k must be from {FEWEST} to the number of points, {len(points)}, got {k}")
    if not radius > 0:
        raise ValueError(f"radius must be a positive length [m], got {radius}")
    tree = point_tree(points)
    # in the tree's order, what one query has read is at hand for the next
    queries = tree.points if at is None else np.ascontiguousarray(at, float)
    rows = tree.order if at is None else np.arange(len(at))
    if k is None:
        moments = _of_ball(tree, _of_nodes(tree), queries, rows, radius)
    else:
        moments = _of_nearest(tree, queries, rows, k)
    counts = moments[:, 0]
    return moments[:, SCATTER] / np.maximum(counts, 1.0)[:, None, None], counts


@kernel
def _add(moments, count, p):
    """Take in so many points in one place, about the common centroid [Chan]."""
    share = count / (moments[0] + count)
    between = moments[0] * share
    dx = p[0] - moments[1]
    dy = p[1] - moments[2]
    dz = p[2] - moments[3]
    moments[0] += count
    moments[1] += share * dx
    moments[2] += share * dy
    moments[3] += share * dz
    moments[4] += between * dx * dx
    moments[5] += between * dx * dy
    moments[6] += between * dx * dz
    moments[7] += between * dy * dy
    moments[8] += between * dy * dz
    moments[9] += between * dz * dz


@kernel
def _add_points(moments, tree, node, p, squared):
    """Take in those points of a node whose squared distance from a place is no more."""
    for i in range(tree.first[node], tree.end[node]):
        if squared_distance(tree, i, p) <= squared:
            _add(moments, 1.0, tree.points[i])


@kernel
def _add_node(moments, node):
    """Take in all points of a node, by its moments."""
    _add(moments, node[0], node[1:4])
    for i in range(4, 10):
        moments[i] += node[i]


@kernel
def _of_nodes(tree):
    """Moments of every node's points."""
    leaves = tree.first.size // 2
    moments = np.zeros((2 * leaves, 10))
    for node in range(2 * leaves - 1, 0, -1):
        if node < leaves:
            _add_node(moments[node], moments[2 * node])
            _add_node(moments[node], moments[2 * node + 1])
        else:
            _add_points(moments[node], tree, node, tree.points[0], np.inf)
    return moments


@kernel
def _of_nearest(tree, queries, rows, k):
    """Moments of the `k` points nearest to each query, in these rows."""
    moments = np.zeros((len(queries), 10))
    squared, found = np.empty(k), np.empty(k, np.int64)
    for m in range(len(queries)):
        nearest(tree, queries[m], squared, found)
        for i in found:
            _add(moments[rows[m]], 1.0, tree.points[i])
    return moments


@kernel
def _of_ball(tree, nodes, queries, rows, radius):
    """Moments of the points within the radius of each query, in these rows; nodes that lie in it
    are taken in whole, so that dense clouds cost no more.
    """
    leaves = tree.first.size // 2
    moments = np.zeros((len(queries), 10))
    waiting = np.ones(DEPTH, np.int64)
    for m in range(len(queries)):
        p = queries[m]
        count = 1
        while count > 0:
            count -= 1
            node = waiting[count]
            if apart(tree, node, p) > radius * radius:
                continue
            if reach(tree, node, p) <= radius * radius:
                _add_node(moments[rows[m]], nodes[node])
            elif node >= leaves:
                _add_points(moments[rows[m]], tree, node, p, radius * radius)
            else:
                waiting[count], waiting[count + 1] = 2 * node, 2 * node + 1
                count += 2
        waiting[0] = 1
    return moments
