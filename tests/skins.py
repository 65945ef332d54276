"""Skins of known shape, for tests of what asks a skin."""

from collections.abc import Callable

import numpy as np

from breastscan.geometry import bicubic, se3
from breastscan.geometry.skin import REACH, Skin, directions

CELLS = 48


def skin_of(
    radius: Callable[[np.ndarray], np.ndarray],
    X_AN: np.ndarray | None = None,
    *,
    cells: int = CELLS,
    sigma: float = 1e-4,
) -> Skin:
    """The skin with this radius [m] over unit vectors (n 3) in its own frame, seen all over, with
    errors of the coefficients that are independent and have this standard deviation [m].
    """
    m = cells + 3
    x = np.linspace(0.0, cells, 4 * m)
    along = _weights(x, m)
    a, b = (side.ravel() for side in np.meshgrid(x, x, indexing="ij"))
    ab = np.column_stack([a, b]) * 2 * REACH / cells - REACH
    sampled = radius(directions(ab)).reshape(len(x), len(x))
    inverse = np.linalg.pinv(along)
    covariance = np.zeros((m * m, bicubic.bandwidth(m) + 1))
    covariance[:, 0] = sigma**2
    return Skin(
        X_AN=np.eye(4) if X_AN is None else X_AN,
        radii=np.ascontiguousarray(inverse @ sampled @ inverse.T),
        covariance=covariance,
        support=np.ones((60, 60), bool),
    )


def ellipsoid(semi_axes: np.ndarray, p_A: np.ndarray) -> Skin:
    """The skin of an ellipsoid about `p_A` [m]."""
    X_AN = se3.pose(np.eye(3), p_A)
    return skin_of(lambda u: 1.0 / np.linalg.norm(u / semi_axes, axis=1), X_AN)


def _weights(x: np.ndarray, m: int) -> np.ndarray:
    """Weights of `m` coefficients at places along one coordinate, in units of the spacing."""
    first, weights = bicubic.first_numbers(np.column_stack([x, np.zeros_like(x)]), m, 4)
    result = np.zeros((len(x), m))
    for k in range(4):
        result[np.arange(len(x)), first // 4 + k] = weights[:, 4 * k : 4 * k + 4].sum(axis=1)
    return result
