"""A smooth chest through the points around a breast's foot."""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import robust, se3
from breastscan.geometry.chest import Chest

TURNS = 3
"""How often the fit is repeated, in the frame of the chest that it found."""
REWEIGHTINGS = 12
"""At most."""
SETTLED = 1e-8
"""Change of the fitted heights that ends them [m]."""
TUKEY = 4.685
"""Residual over its scale beyond which a point does not count [Tukey]."""
LEAST_SCALE = 2e-5
"""Residuals are never taken to be smaller than this [m]."""
GIVEN_UP = 0.2
"""How much larger the residuals of a simpler chest are than those of the best one, as a root of the
difference of squares over the tolerance, for it to be given up [-]."""


def fit_chest(
    p: Float[np.ndarray, "n 3"],
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    tolerance: float,
) -> Chest:
    """The chest through the points that most agree on, flat where they lie on a plane as well.

    Args:
        p: Points, most of them on the chest [m].
        middle: Middle of the breast's foot, near the chest [m].
        normal: About its normal there, outwards.
        tolerance: Farthest from the chest that a point of it may lie [m].
    """
    flat = fit_plane(p, middle, normal, tolerance)
    bent = _fit(p, middle, normal, tolerance, bends=True)
    return flat if lie_as_well(p, flat, bent, tolerance) else bent


def fit_plane(
    p: Float[np.ndarray, "n 3"],
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    tolerance: float,
) -> Chest:
    """The flat chest through the points that most agree on; arguments as of `fit_chest`."""
    return _fit(p, middle, normal, tolerance, bends=False)


def lie_as_well(
    p: Float[np.ndarray, "n 3"], simpler: Chest, other: Chest, tolerance: float
) -> bool:
    """Whether the points lie about as well on a simpler chest, or on one that more points agree on,
    as on another: neighbours have errors in common, which tell of no shape.
    """
    error, least = (_scale(chest.heights(p), tolerance) for chest in (simpler, other))
    return error**2 <= least**2 + (GIVEN_UP * tolerance) ** 2


def _scale(residuals: Float[np.ndarray, "n"], tolerance: float) -> float:
    """Standard deviation of the residuals of most points about zero [m]."""
    return float(np.clip(robust.deviation(residuals), LEAST_SCALE, tolerance))


def _fit(
    p: Float[np.ndarray, "n 3"],
    middle: Float[np.ndarray, "3"],
    normal: Float[np.ndarray, "3"],
    tolerance: float,
    *,
    bends: bool,
) -> Chest:
    chest = _plane_at(middle, normal)
    weights = np.ones(len(p))
    for _ in range(TURNS):
        axes = se3.axes_along(chest.normal)
        local = (p - chest.middle) @ axes.T
        terms, weights = _robust(local, weights, tolerance, bends=bends)
        chest = _chest(chest.middle, axes, terms)
    return chest


def _plane_at(middle: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"]) -> Chest:
    unit = normal / np.linalg.norm(normal)
    return Chest(normal=unit, offset=float(unit @ middle), middle=middle, bend=np.zeros((3, 3)))


def _robust(
    local: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, "n"],
    tolerance: float,
    *,
    bends: bool,
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n"]]:
    """Coefficients of 1, u, v, u^2, u v, v^2 by iteratively reweighted least squares from these
    weights on, and the weights in the end.
    """
    u, v, z = local.T
    reach = float(np.sqrt(np.mean(u**2 + v**2)))
    u, v = u / reach, v / reach
    columns = [np.ones_like(u), u, v, *([u * u, u * v, v * v] if bends else [])]
    A = np.stack(columns, axis=1)
    found = np.zeros(A.shape[1])
    for _ in range(REWEIGHTINGS):
        before = found
        weighted = A * weights[:, None]
        found = np.linalg.lstsq(weighted.T @ A, weighted.T @ z, rcond=None)[0]
        residual = z - A @ found
        allowed = TUKEY * _scale(residual, tolerance)
        weights = np.clip(1 - (residual / allowed) ** 2, 0.0, None) ** 2
        if np.abs(found - before).max() < SETTLED:
            break
    terms = np.zeros(6)
    terms[: len(found)] = found
    return terms / reach ** np.array([0, 1, 1, 2, 2, 2]), weights


def _chest(
    middle: Float[np.ndarray, "3"], axes: Float[np.ndarray, "3 3"], terms: Float[np.ndarray, "6"]
) -> Chest:
    """The chest of a polynomial over two axes, about the point of it above `middle`."""
    constant, du, dv, uu, uv, vv = terms
    normal = axes[2] - du * axes[0] - dv * axes[1]
    normal /= np.linalg.norm(normal)
    on_chest = middle + constant * axes[2]
    bend = -axes[:2].T @ np.array([[2 * uu, uv], [uv, 2 * vv]]) @ axes[:2]
    across = np.eye(3) - np.outer(normal, normal)
    return Chest(
        normal=normal,
        offset=float(normal @ on_chest),
        middle=on_chest,
        bend=across @ bend @ across * float(normal @ axes[2]),
    )
