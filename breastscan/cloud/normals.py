"""Surface normals from the spread of each point's neighbourhood [Zhang, Eqs. 13-15]."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

RADIUS = 6e-3
"""Neighbourhood [m]: depth noise of .35 mm at .8 mm pitch then tilts a normal by 1 degree."""
FEWEST = 3
"""Points that define a plane."""


def estimate_normals(
    points: Float[np.ndarray, "n 3"],
    *,
    at: Float[np.ndarray, "m 3"] | None = None,
    radius: float = RADIUS,
    k: int | None = None,
) -> Float[np.ndarray, "m 3"]:
    """Unit normals in L, towards the camera at L's origin; NaN where fewer than three points are
    near.

    Args:
        points: The cloud in L [m].
        at: Where to estimate, in L [m]; at every point of the cloud by default.
        radius: Points no farther than this count as neighbours [m].
        k: Use this many nearest points instead, at whatever distance.
    """
    queries = points if at is None else at
    covariances, counts = _covariances(points, queries, radius, k)
    # the eigenvector of the smallest eigenvalue [Zhang, Eq. 14]
    normals = np.linalg.eigh(covariances)[1][..., 0]
    # v = -p, v . n > 0 [Zhang, Eq. 15]
    towards_camera = -np.sign(np.sum(normals * queries, axis=-1))
    return np.where(counts[:, None] < FEWEST, np.nan, normals * towards_camera[:, None])


def surface_variation(
    points: Float[np.ndarray, "n 3"], *, radius: float = RADIUS, k: int | None = None
) -> Float[np.ndarray, "n"]:
    """Fraction of the neighbourhood's spread that lies across the surface: 0 on a plane, growing as
    it bends.
    """
    covariances, _ = _covariances(points, points, radius, k)
    spread = np.linalg.eigvalsh(covariances)
    return np.maximum(spread[:, 0], 0.0) / np.maximum(spread.sum(axis=1), np.finfo(float).tiny)


def _covariances(
    points: Float[np.ndarray, "n 3"],
    queries: Float[np.ndarray, "m 3"],
    radius: float,
    k: int | None,
) -> tuple[Float[np.ndarray, "m 3 3"], np.ndarray]:
    """Covariance of each query's neighbourhood about its own centroid [Zhang, Eq. 13], and how
    many points it has.
    """
    neighbours, counts = _neighbours(points, queries, radius, k)
    owner = np.repeat(np.arange(len(queries)), counts)
    # small numbers: moments about a far origin would cancel
    local = points[neighbours] - queries[owner]
    reciprocal = 1.0 / np.maximum(counts, 1)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(owner, weights=values, minlength=len(queries)) * reciprocal

    centroid = np.stack([mean(local[:, i]) for i in range(3)], axis=-1)
    covariances = np.empty((len(queries), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            covariances[:, i, j] = mean(local[:, i] * local[:, j]) - centroid[:, i] * centroid[:, j]
            covariances[:, j, i] = covariances[:, i, j]
    return covariances, counts


def _neighbours(
    points: Float[np.ndarray, "n 3"],
    queries: Float[np.ndarray, "m 3"],
    radius: float,
    k: int | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of every query's neighbours, one query after the other, and how many each has."""
    tree = KDTree(points)
    if k is not None:
        if not FEWEST <= k <= len(points):
            raise ValueError(
                f"k must be from {FEWEST} to the number of points, {len(points)}, got {k}"
            )
        return tree.query(queries, k=k)[1].ravel(), np.full(len(queries), k)
    if radius <= 0:
        raise ValueError(f"radius must be a positive length [m], got {radius}")
    found = tree.query_ball_point(queries, radius)
    counts = np.fromiter(map(len, found), int, len(queries))
    return np.concatenate([np.asarray(indices, int) for indices in found]), counts
