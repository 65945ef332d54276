"""The breast's shape all around, as its mesh needs it: smooth, closed down to the chest where
nothing was seen, and no finer than the tissue feels.

Over the chest the shape is a radius for every direction from the middle of the foot, in spherical
harmonics of a low degree. Where points are missing, bending is kept low: that carries the flank on
to its foot.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import sph_harm_y_all

from breastscan.errors import PlanningError
from breastscan.geometry import robust, se3
from breastscan.geometry.plane import Plane
from breastscan.tissue.mesh import half_shell

DEGREE = 8
"""Of the spherical harmonics [-]: details of 20 degrees."""
BENDING = 3e-8
"""Weight of the squared bending of the relative radius against its squared error [-]."""
OUTLIER = 4.0
"""Residual, in robust standard deviations, from which a point is left out."""
FEWEST_POINTS = 2 * (DEGREE + 1) ** 2
"""Points that a shape needs."""
CHECKED = 0.1
"""Spacing of the directions in which the shape is checked [rad]."""
SHORTEST = 0.2
"""Least distance of the skin from the middle of the foot, over its mean [-]."""
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""The mesh is not quite symmetric: so it lies for the figures in docs/drag.md."""
COLUMN_STEPS = 3
"""Steps to a point's place over a chest that is not flat."""


@dataclass(frozen=True, kw_only=True)
class StarShape:
    """A breast on its chest, every point of its skin seen from the middle of its foot."""

    foot_B: Float[np.ndarray, "3"]
    """The middle of its foot, on the chest [m]."""
    axes_B: Float[np.ndarray, "3 3"]
    """Rows: two directions along the chest, and the chest's outward normal."""
    chest: Plane
    radius: float
    """Mean distance of the skin from the middle of the foot [m]."""
    harmonics: Float[np.ndarray, "h"]
    """Coefficients of the distance over `radius` [-]."""

    @staticmethod
    def fit(points_B: Float[np.ndarray, "n 3"], chest: Plane) -> "StarShape":
        """The shape nearest to points on the skin in B [m], outliers left out.

        Raises:
            PlanningError: The points are too few, or do not go round their middle.
        """
        if len(points_B) < FEWEST_POINTS:
            raise PlanningError(
                f"expected {FEWEST_POINTS} points or more of the skin for a model of its tissue, "
                f"got {len(points_B)}: keep more points of the cloud",
                len(points_B),
            )
        axes_B = HALF_TURN @ se3.axes_along(chest.normal)
        middle_B = points_B.mean(axis=0)
        foot_B = middle_B - chest.heights(middle_B[None]) * chest.normal
        local = np.column_stack([(points_B - foot_B) @ axes_B[:2].T, chest.heights(points_B)])
        distance = np.linalg.norm(local, axis=1)
        radius = float(np.median(distance))
        terms = _harmonics(local / distance[:, None])
        harmonics = _fit(terms, distance / radius)
        residual = terms @ harmonics - distance / radius
        inlier = np.abs(residual) <= OUTLIER * robust.deviation(residual)
        shape = StarShape(
            foot_B=foot_B,
            axes_B=axes_B,
            chest=chest,
            radius=radius,
            harmonics=_fit(terms[inlier], distance[inlier] / radius),
        )
        shape._require_star()
        return shape

    def embed(self, ball: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of the unit half-ball z >= 0 mapped into the breast, in B [m]."""
        length = np.linalg.norm(ball, axis=1, keepdims=True)
        direction = ball / np.where(length > 0, length, 1.0)
        local = ball * (self.radius * _harmonics(direction) @ self.harmonics)[:, None]
        p_B = self.foot_B + local @ self.axes_B
        for _ in range(COLUMN_STEPS):  # none for a flat chest, where the first is exact
            p_B += (local[:, 2] - self.chest.heights(p_B))[:, None] * self.axes_B[2]
        return p_B

    def _require_star(self) -> None:
        """Refuse a shape that passes through the middle of its own foot."""
        directions = half_shell(CHECKED, rotation=0.0)
        least = float((_harmonics(directions) @ self.harmonics).min())
        if not least > SHORTEST:
            raise PlanningError(
                "expected skin all around the middle of the breast for a model of its tissue, "
                f"found it {least * self.radius * 1e3:.0f} mm from there on one side: look at the "
                "cloud for a side that was not seen",
                least,
            )


def _fit(
    terms: Float[np.ndarray, "n h"], distances: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "h"]:
    """Coefficients of the harmonics with the least mean squared error and bending."""
    degree = np.concatenate([np.full(2 * order + 1, order) for order in range(DEGREE + 1)])
    bending = BENDING * (degree * (degree + 1.0)) ** 2
    normal = terms.T @ terms / len(terms) + np.diag(bending)
    return np.linalg.solve(normal, terms.T @ distances / len(terms))


def _harmonics(direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n h"]:
    """Real spherical harmonics up to `DEGREE` at unit directions, degree by degree."""
    polar = np.arccos(np.clip(direction[:, 2], -1.0, 1.0))
    azimuth = np.arctan2(direction[:, 1], direction[:, 0])
    complex_valued = sph_harm_y_all(DEGREE, DEGREE, polar, azimuth)
    columns = []
    for degree in range(DEGREE + 1):
        columns.append(complex_valued[degree, 0].real)
        for order in range(1, degree + 1):
            columns += [complex_valued[degree, order].real, complex_valued[degree, order].imag]
    return np.stack(columns, axis=1)
