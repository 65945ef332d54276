"""Scan paths on the reconstructed skin: the loop at half height of the breast [Zhang, Sec. III-D,
Figs. 13, 14].

Every point of a path, and its normal, come from a quadratic patch fitted to the cloud around it
(`planning.patch`): the path lies on the skin although the points of the cloud do not.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.nurbs import Nurbs
from breastscan.geometry.plane import Plane
from breastscan.planning.patch import MlsSurface

TRACED_POINTS = 60
"""Points of the loop, even in azimuth, from which the evenly spaced ones are chosen."""
SEED_POINTS = 12
"""Points of the cloud, nearest in azimuth, whose mean starts the search for a point of the loop."""
TOP_FRACTION = 0.01
"""Fraction of the points, the highest ones, among which the top of the breast is sought."""
TOP_PATCHES = 40
"""Patches fitted there."""
TOP_RADIUS = 0.006
"""Reach of these patches [m]: they must follow a nipple."""
TOP_POINTS = 24
"""Points that they must have: they reach farther where the cloud is thin."""


@dataclass(frozen=True, kw_only=True)
class PatternConfig:
    """How the scan path lies on the breast."""

    points: int = 15
    """Points of the loop, evenly spaced [Zhang, Sec. V-B.1]."""
    height_fraction: float = 0.5
    """Height of the loop as a fraction of the breast's height above the chest plate [-]."""
    patch_radius: float = 0.016
    """Reach of the local fits [m]: greater averages more noise, smaller follows finer shape."""
    largest_gap: float = 0.5
    """Angle without any point, seen from the centre of the loop, that is bridged [rad]."""
    smallest_radius: float = 0.015
    """Radius below which a loop is not scanned [m]."""

    def __post_init__(self) -> None:
        if self.points < 4:
            raise ConfigError(
                f"planning.pattern.points must be 4 or more for a cubic curve, not {self.points}",
                self.points,
            )
        if not 0.0 < self.height_fraction < 1.0:
            raise ConfigError(
                "planning.pattern.height_fraction must lie between 0 and 1, not "
                f"{self.height_fraction}",
                self.height_fraction,
            )
        require_positive(self, "planning.pattern")


@dataclass(frozen=True, kw_only=True)
class Path:
    """Ordered points on the skin and the outward normals there; a closed path returns to its
    first point by itself.
    """

    points_B: Float[np.ndarray, "n 3"]
    """Points in B [m]."""
    normals_B: Float[np.ndarray, "n 3"]
    """Unit normals, outwards."""
    closed: bool = True

    @cached_property
    def curve(self) -> Nurbs:
        """The curve through the points."""
        return Nurbs.interpolate(self.points_B, closed=self.closed)

    def normals(self, u: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """Unit normals at any parameter of `curve`, as smooth as the curve itself."""
        n_B = self._normal_curve.evaluate(u)
        return n_B / np.linalg.norm(n_B, axis=1, keepdims=True)

    @cached_property
    def _normal_curve(self) -> Nurbs:
        u = self.curve.breaks[: len(self.points_B)]
        return Nurbs.interpolate(self.normals_B, closed=self.closed, parameters=u)


def half_height_loop(
    points_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    plate: Plane,
    config: PatternConfig,
) -> Path:
    """The closed loop round the breast at `config.height_fraction` of its height above the chest
    plate.

    It starts on the side that is nearest to the robot and runs counter-clockwise about the plate's
    normal.

    Args:
        points_B: The reconstructed skin in B [m].
        normals_B: Unit normals there, outwards.
        plate: Where the breast's height counts from.
        config: Number of points, height, reach of the local fits.

    Raises:
        PlanningError: The loop is too small or does not close, or the skin has a hole on its way.
    """
    surface = MlsSurface(points_B=points_B, normals_B=normals_B, radius=config.patch_radius)
    return level_loop(surface, plate, config.height_fraction * top_height(surface, plate), config)


def top_height(surface: MlsSurface, plate: Plane) -> float:
    """Height of the breast's top, the nipple's tip, above the plate [m].

    Small patches at some of the highest points: noise does not raise them, nor does the breast
    below lower them.
    """
    heights = plate.heights(surface.points_B)
    highest = np.argsort(heights)[-max(math.ceil(TOP_FRACTION * len(heights)), TOP_PATCHES) :]
    some_B = surface.points_B[highest[:: math.ceil(len(highest) / TOP_PATCHES)]]
    reach = float(surface.tree.query(some_B, TOP_POINTS)[0].max())
    summit = replace(surface, radius=max(TOP_RADIUS, reach))
    grid = np.linspace(-summit.radius / 4, summit.radius / 4, 9)
    xy = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    patches = [summit.patch(p_B, plate.normal) for p_B in some_B]
    best = max(patches, key=lambda patch: float(plate.heights(patch.point(np.zeros(2))[None])[0]))
    return float(plate.heights(best.origin_B[None])[0] + best.heights(xy).max())


def level_loop(surface: MlsSurface, plate: Plane, height: float, config: PatternConfig) -> Path:
    """The closed loop round the breast at `height` [m] above the plate."""
    ring = _Ring.around(surface, plate, height, config)
    azimuths = 2.0 * np.pi * np.arange(TRACED_POINTS) / TRACED_POINTS
    traced_B = np.stack([ring.trace(azimuth)[0] for azimuth in azimuths])
    radius = float(np.linalg.norm(traced_B - traced_B.mean(axis=0), axis=1).min())
    if radius < config.smallest_radius:
        raise PlanningError(
            f"the loop at {height * 1e3:.0f} mm above the plate has a radius of {radius * 1e3:.0f} "
            f"mm, the smallest to be scanned is {config.smallest_radius * 1e3:.0f} mm: choose a "
            "lower loop",
            radius,
        )
    curve = Nurbs.interpolate(traced_B)
    even_B = curve.evaluate(
        curve.parameter(curve.length * np.arange(config.points) / config.points)
    )
    points_B, normals_B = zip(
        *(ring.trace(azimuth) for azimuth in ring.azimuths(even_B)), strict=True
    )
    return Path(points_B=np.stack(points_B), normals_B=np.stack(normals_B))


@dataclass(frozen=True, kw_only=True)
class _Ring:
    """The part of the surface around one height, and polar coordinates about its centre."""

    surface: MlsSurface
    plate: Plane
    height: float
    centre_B: np.ndarray
    axes: np.ndarray
    """Rows in basis B: azimuth 0 (towards the robot), azimuth 90 degrees, the plate's normal."""
    band: np.ndarray
    """Indices of the surface's points near the height."""
    band_azimuths: np.ndarray

    @staticmethod
    def around(surface: MlsSurface, plate: Plane, height: float, config: PatternConfig) -> "_Ring":
        heights = plate.heights(surface.points_B)
        band = np.flatnonzero(np.abs(heights - height) < config.patch_radius / 2)
        if len(band) < TRACED_POINTS:
            raise PlanningError(
                f"only {len(band)} points lie near the height of {height * 1e3:.0f} mm above the "
                f"chest plate, a loop needs {TRACED_POINTS}: check that the cameras see the breast "
                "and that the plate's height is right",
                len(band),
            )
        axes = plate_axes(plate, surface.points_B[band].mean(axis=0))
        centre_B = _circle_centre(surface.points_B[band], axes)
        azimuths = _azimuths(surface.points_B[band], centre_B, axes)
        _check_gaps(azimuths, config.largest_gap)
        return _Ring(
            surface=surface,
            plate=plate,
            height=height,
            centre_B=centre_B,
            axes=axes,
            band=band,
            band_azimuths=azimuths,
        )

    def azimuths(self, p_B: np.ndarray) -> np.ndarray:
        return _azimuths(p_B, self.centre_B, self.axes)

    def trace(self, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
        """The skin's point at this azimuth and the ring's height, and its normal."""
        apart = np.abs(np.angle(np.exp(1j * (self.band_azimuths - azimuth))))
        seeds = self.band[np.argpartition(apart, SEED_POINTS)[:SEED_POINTS]]
        p_B = self.surface.points_B[seeds].mean(axis=0)
        n_B = self.surface.normals_B[seeds].mean(axis=0)
        sideways_B = -math.sin(azimuth) * self.axes[0] + math.cos(azimuth) * self.axes[1]
        planes_B = np.stack([self.axes[2], sideways_B])
        offsets = np.array([self.plate.offset + self.height, self.centre_B @ sideways_B])
        return self.surface.meet(p_B, n_B / np.linalg.norm(n_B), planes_B, offsets)


def plate_axes(plate: Plane, centre_B: np.ndarray) -> np.ndarray:
    """Rows: towards the robot along the plate, across, and the plate's normal."""
    towards_B = -(centre_B - plate.normal * (plate.normal @ centre_B))
    towards_B /= np.linalg.norm(towards_B)
    return np.stack([towards_B, np.cross(plate.normal, towards_B), plate.normal])


def _circle_centre(p_B: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Centre of the circle through the points as the plate sees them: uneven density does not
    move it.
    """
    local = p_B @ axes.T
    A = np.column_stack([2.0 * local[:, :2], np.ones(len(local))])
    x, y, _ = np.linalg.lstsq(A, np.sum(local[:, :2] ** 2, axis=1), rcond=None)[0]
    return np.array([x, y, local[:, 2].mean()]) @ axes


def _azimuths(p_B: np.ndarray, centre_B: np.ndarray, axes: np.ndarray) -> np.ndarray:
    x, y, _ = ((p_B - centre_B) @ axes.T).T
    return np.arctan2(y, x)


def _check_gaps(azimuths: np.ndarray, largest: float) -> None:
    ordered = np.sort(azimuths)
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    widest = int(np.argmax(gaps))
    if gaps[widest] > largest:
        raise PlanningError(
            f"the loop does not close: no skin was seen over {np.degrees(gaps[widest]):.0f} "
            f"degrees, from {np.degrees(ordered[widest]):.0f} degrees on (0 is towards the robot, "
            f"counter-clockwise), and only {np.degrees(largest):.0f} are bridged: move the "
            "cameras, the light or the phantom so that all sides are seen",
            float(gaps[widest]),
        )
