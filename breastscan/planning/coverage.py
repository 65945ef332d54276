"""Scan paths that cover the whole breast: nested loops, a spiral, radial strokes, parallel strokes
(raster).

Every path is a sequence of rays from the centre of the breast's foot: the skin meets each of them
once, near the top as well as low on the side, where neither heights nor places on the plate would
say where on the skin one is.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.skin import Skin
from breastscan.planning import pattern
from breastscan.planning.pattern import Path


@dataclass(frozen=True, kw_only=True)
class Dome:
    """A breast's skin in B, seen from the middle of its foot."""

    skin: Skin

    def path(self, rays: Float[np.ndarray, "n 3"], closed: bool) -> Path:
        """Where the skin meets rays from the middle of the foot: x along the chest towards the
        robot, z along the skin's axis.

        Raises:
            PlanningError: No skin was seen there.
        """
        ahead, aside = pattern.towards_robot(self.skin)
        axes_N = np.stack([[*ahead, 0.0], [*aside, 0.0], [0.0, 0.0, 1.0]])
        rays_B = se3.rotate(self.skin.X_AN, rays @ axes_N)
        return pattern.path_on(self.skin, self.skin.chart(self.skin.centre + rays_B), closed=closed)


def loops(dome: Dome, polar_angles: Float[np.ndarray, "k"], points: int) -> list[Path]:
    """Nested closed loops, `points` each, at angles from the breast's axis [rad]."""
    _check_polar(polar_angles)
    azimuths = 2.0 * np.pi * np.arange(points) / points
    return [
        dome.path(_rays(np.full(points, polar), azimuths), closed=True) for polar in polar_angles
    ]


def spiral(dome: Dome, innermost: float, outermost: float, turns: float, spacing: float) -> Path:
    """A spiral from `innermost` to `outermost` angle from the breast's axis [rad].

    Args:
        dome: The breast.
        innermost: Where it starts [rad].
        outermost: Where it ends [rad].
        turns: Number of revolutions.
        spacing: Angle between neighbouring points, seen from the centre [rad].
    """
    _check_polar(np.array([innermost, outermost]))
    fraction = np.linspace(0.0, 1.0, 2000)
    polar, azimuth = innermost + (outermost - innermost) * fraction, 2.0 * np.pi * turns * fraction
    steps = np.hypot(np.diff(polar), np.sin(polar[1:]) * np.diff(azimuth))
    distance = np.append(0.0, np.cumsum(steps))
    even = np.interp(
        np.linspace(0.0, distance[-1], math.ceil(distance[-1] / spacing) + 1), distance, fraction
    )
    return dome.path(
        _rays(innermost + (outermost - innermost) * even, 2.0 * np.pi * turns * even), closed=False
    )


def radial(dome: Dome, outermost: float, strokes: int, points: int) -> list[Path]:
    """Strokes over the top from side to side, evenly rotated about the breast's axis.

    Args:
        dome: The breast.
        outermost: Angle from the axis at which they start and end [rad].
        strokes: Number of strokes.
        points: Points of each.
    """
    _check_polar(np.array([outermost]))
    polar = np.linspace(outermost, -outermost, points)
    return [
        dome.path(_rays(polar, np.full(points, np.pi * stroke / strokes)), closed=False)
        for stroke in range(strokes)
    ]


def raster(dome: Dome, outermost: float, strokes: int, points: int) -> list[Path]:
    """Strokes side by side, alternately to and fro, fanned about an axis through the centre.

    Args:
        dome: The breast.
        outermost: Angle from the breast's axis that no stroke passes [rad].
        strokes: Number of strokes.
        points: Points of each.
    """
    _check_polar(np.array([outermost]))
    tilts = outermost * (2.0 * np.arange(strokes) + 1.0 - strokes) / strokes
    paths = []
    for stroke, tilt in enumerate(tilts):
        reach = math.acos(math.cos(outermost) / math.cos(tilt))
        along = np.linspace(-reach, reach, points) * (-1) ** stroke
        rays = np.stack(
            [np.sin(tilt) * np.cos(along), np.sin(along), np.cos(tilt) * np.cos(along)], axis=1
        )
        paths.append(dome.path(rays, closed=False))
    return paths


def _rays(polar: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    return np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1
    )


def _check_polar(polar_angles: np.ndarray) -> None:
    if not ((polar_angles > 0.0) & (polar_angles < np.pi / 2)).all():
        raise PlanningError(
            "angles from the breast's axis must lie between 0 and pi / 2 (the chest plate), got "
            f"{polar_angles}",
            polar_angles,
        )
