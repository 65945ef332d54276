"""The chest that the breast lies on: how it is tilted, and how it falls away to the sides.

It is a parabolic cylinder about the body's long axis, z_S = -y_S^2 / (2 radius). The patient's
frame S stands on its crest, in the middle of the breast's base.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from breastscan.errors import ConfigError

LARGEST_TILT = math.radians(45.0)
"""Beyond, the chest stands rather than lies [rad]."""
SMALLEST_RADIUS = 0.1
"""Of a chest that a breast finds room on [m]."""
NEWTON_STEPS = 30
CLOSE = 1e-12
"""Step that ends the search for the closest point of the chest [m]."""


@dataclass(frozen=True, kw_only=True)
class ChestConfig:
    """How the chest lies and how it is curved; by default it is a level plate."""

    tilt: float = 0.0
    """Angle of the chest's normal against the vertical [rad]."""
    azimuth: float = 0.0
    """Side to which the normal leans, counter-clockwise from the x axis of the robot's base
    [rad]."""
    radius: float | None = None
    """Radius of curvature across the body's long axis, in the middle of the breast's base [m]; None
    for a flat chest."""

    def __post_init__(self) -> None:
        if not 0 <= self.tilt <= LARGEST_TILT:
            raise ConfigError(
                f"tilt must lie in 0 .. {LARGEST_TILT:.3f} rad, got {self.tilt}: turn azimuth to "
                "lean to another side",
                self.tilt,
            )
        if not math.isfinite(self.azimuth):
            raise ConfigError(f"azimuth must be a finite angle, got {self.azimuth}", self.azimuth)
        if self.radius is not None and not SMALLEST_RADIUS <= self.radius < math.inf:
            raise ConfigError(
                f"radius must be {SMALLEST_RADIUS} m or more, or none for a flat chest, got "
                f"{self.radius}",
                self.radius,
            )

    @property
    def curvature(self) -> float:
        """Across the body's long axis, in the middle of the breast's base [1/m]."""
        return 0.0 if self.radius is None else 1 / self.radius

    @property
    def R_BS(self) -> Float[np.ndarray, "3 3"]:
        """How S is rotated against B: the shortest way from the vertical to the tilted normal."""
        axis = np.array([-math.sin(self.azimuth), math.cos(self.azimuth), 0.0])
        return Rotation.from_rotvec(self.tilt * axis).as_matrix()


@numba.njit(cache=True)
@no_type_check
def height_over(curvature, y, z):
    """Signed distance of a point of S to the chest [m], positive above; of one so deep that it lies
    beyond the chest's centre of curvature, no more than a bound.
    """
    nearest = nearest_across(curvature, y, z)
    off = z + curvature * nearest * nearest / 2
    distance = math.sqrt((y - nearest) ** 2 + off * off)
    return distance if z + curvature * y * y / 2 > 0 else -distance


@numba.njit(cache=True)
@no_type_check
def nearest_across(curvature, y, z):
    """y_S of the chest's point that is nearest to (y, z): the root of a rising cubic."""
    linear = max(1 + curvature * z, 0.1)
    nearest = y
    for _ in range(NEWTON_STEPS):
        squared = curvature * curvature * nearest * nearest
        step = (nearest * (linear + squared / 2) - y) / (linear + 1.5 * squared)
        nearest -= step
        if abs(step) < CLOSE:
            break
    return nearest


@numba.njit(cache=True)
@no_type_check
def heights_over(curvature, p_S):
    """`height_over` of every row."""
    heights = np.empty(len(p_S))
    for i in range(len(p_S)):
        heights[i] = height_over(curvature, p_S[i, 1], p_S[i, 2])
    return heights
