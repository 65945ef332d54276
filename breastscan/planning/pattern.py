"""Scan paths on the skin: the loop at half height of the breast [Zhang, Sec. III-D, Figs. 13, 14].

Every point of a path, and its normal, are the skin's own (`geometry.skin`); a path never crosses
skin that was not seen.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
import tyro
from jaxtyping import Bool, Float

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.nurbs import Nurbs
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import REACH, Skin

Kind = Literal["loop", "loops", "spiral", "radial", "antiradial", "raster"]
TRACED_POINTS = 180
"""Points of the loop, even in azimuth about the top, from which the evenly spaced ones are
chosen."""
TRACE_STEP = 0.02
"""Step along an azimuth in search of the loop's height [rad in the chart]."""
TRACE_HALVINGS = 24
"""Of such a step: to a nanometre."""
TOP_REACH = 1.2
"""Angle from the chart's axis within which the top is sought [rad]."""
TOP_STEPS = (0.03, 0.004, 0.0005)
"""Spacings of the grids on which it is sought, one around the best of that before [rad]."""
SECTOR_DEG = 10
"""Width of the sectors in which missing skin is told."""
TOP_STEPS_ASIDE = 10
"""Steps to each side of the finer grids."""


@dataclass(frozen=True, kw_only=True)
class PatternConfig:
    """How the scan's strokes lie on the breast."""

    kind: Annotated[Kind, tyro.conf.arg(aliases=("--pattern",))] = "loop"
    """A single loop, or strokes that together cover the breast: nested loops with the array along
    them, radii with it across, or a raster with it across."""
    points: int = 15
    """Points of the loop, evenly spaced [Zhang, Sec. V-B.1]."""
    height_fraction: float = 0.5
    """Height of the loop as a fraction of the breast's height above the chest plate [-]."""
    smallest_radius: float = 0.015
    """Radius below which a loop is not scanned [m]."""

    @property
    def loop_height(self) -> float | None:
        """`height_fraction`, of a single loop."""
        return self.height_fraction if self.kind == "loop" else None

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
    """Ordered points on the skin and the outward normals that the probe is to stand along; a closed
    path returns to its first point by itself.
    """

    points_B: Float[np.ndarray, "n 3"]
    """Points that are to be touched, in B [m]."""
    normals_B: Float[np.ndarray, "n 3"]
    """Unit normals, outwards: the skin's in these points, or where it is pressed for them."""
    closed: bool = True
    array_along: bool = False
    """Whether the array is to lie along the direction of travel, not across it."""

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


def half_height_loop(skin: Skin, plate: Plane, config: PatternConfig, rise: float = 0.0) -> Path:
    """The closed loop round the breast at `config.height_fraction` of its height above the chest
    plate.

    It starts on the side that is nearest to the robot and runs counter-clockwise about the skin's
    axis.

    Args:
        skin: The breast's, in B.
        plate: Where heights count from, in B.
        config: Number of points, height, smallest radius.
        rise: How much higher the loop is to lie [m].

    Raises:
        PlanningError: The loop is too small, or crosses skin that was not seen.
    """
    level = _Level.around(skin, plate, config.height_fraction, rise)
    height = level.height
    traced_ab = level.trace(2.0 * np.pi * np.arange(TRACED_POINTS) / TRACED_POINTS)
    _require_known(skin, traced_ab, skin.known(traced_ab), f"the loop at {height * 1e3:.0f} mm")
    traced_B = skin.points(traced_ab)
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
    return _on_skin(skin, level.trace(level.azimuths(even_B)), closed=True)


def pressed_at(path: Path, skin: Skin, places_B: Float[np.ndarray, "n 3"]) -> Path:
    """The path with the skin's normals in other places, where the probe presses to touch its
    points.
    """
    return replace(path, normals_B=skin.normals(skin.chart(places_B)))


def top(skin: Skin, plate: Plane) -> Float[np.ndarray, "2"]:
    """Where the breast's top is, the nipple's tip, in the skin's chart [rad].

    Raises:
        PlanningError: It was not seen.
    """
    best, aside = np.zeros(2), round(TOP_REACH / TOP_STEPS[0])
    for step in TOP_STEPS:
        side = step * np.arange(-aside, aside + 1)
        ab = best + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        ab = ab[skin.known(ab)]
        if not len(ab):
            break
        best = ab[np.argmax(plate.heights(skin.points(ab)))]
        aside = TOP_STEPS_ASIDE
    if not skin.known(best[None])[0]:
        raise PlanningError(
            "no skin was seen where the top of the breast must be: move the cameras until both see "
            "the nipple",
            best,
        )
    return best


def path_on(skin: Skin, ab: Float[np.ndarray, "n 2"], *, closed: bool) -> Path:
    """The path through places of the skin's chart.

    Raises:
        PlanningError: Skin was not seen at one of them.
    """
    _require_known(skin, ab, skin.known(ab), "the path")
    return _on_skin(skin, ab, closed=closed)


def _on_skin(skin: Skin, ab: Float[np.ndarray, "n 2"], *, closed: bool) -> Path:
    return Path(points_B=skin.points(ab), normals_B=skin.normals(ab), closed=closed)


@dataclass(frozen=True, kw_only=True)
class _Level:
    """The skin at one height, by azimuth about the top."""

    skin: Skin
    plate: Plane
    height: float
    top_ab: np.ndarray
    axes: np.ndarray
    """Rows in the chart: azimuth 0 (towards the robot), azimuth 90 degrees."""

    @staticmethod
    def around(skin: Skin, plate: Plane, height_fraction: float, rise: float) -> "_Level":
        """At a fraction of the top's height, and `rise` [m] above that."""
        top_ab = top(skin, plate)
        top_height = float(plate.heights(skin.points(top_ab[None]))[0])
        return _Level(
            skin=skin,
            plate=plate,
            height=height_fraction * top_height + rise,
            top_ab=top_ab,
            axes=towards_robot(skin),
        )

    def azimuths(self, p_B: np.ndarray) -> np.ndarray:
        x, y = ((self.skin.chart(p_B) - self.top_ab) @ self.axes.T).T
        return np.arctan2(y, x)

    def trace(self, azimuths: np.ndarray) -> np.ndarray:
        """Where the skin first comes down to the height, from the top outwards, in the chart."""
        out = np.column_stack([np.cos(azimuths), np.sin(azimuths)]) @ self.axes
        steps = TRACE_STEP * np.arange(int(2 * REACH / TRACE_STEP))
        ab = self.top_ab + steps[:, None, None] * out
        below = self._below(ab.reshape(-1, 2)).reshape(len(steps), -1)
        below[-1] = True  # the chart's end is no place for a loop, and not known
        far = steps[np.argmax(below, axis=0)]
        near = far - TRACE_STEP
        for _ in range(TRACE_HALVINGS):
            middle = (near + far) / 2
            is_below = self._below(self.top_ab + middle[:, None] * out)
            far, near = np.where(is_below, middle, far), np.where(is_below, near, middle)
        return self.top_ab + far[:, None] * out

    def _below(self, ab: np.ndarray) -> np.ndarray:
        return self.plate.heights(self.skin.points(ab)) < self.height


def towards_robot(skin: Skin) -> Float[np.ndarray, "2 2"]:
    """Directions in the chart of a skin in B, as rows: towards the robot, and a quarter turn on."""
    x, y = -(skin.X_AN[:3, :2].T @ skin.centre)
    towards = np.array([x, y]) / np.hypot(x, y)
    return np.stack([towards, [-towards[1], towards[0]]])


def _require_known(
    skin: Skin, ab: Float[np.ndarray, "n 2"], known: Bool[np.ndarray, "n"], what: str
) -> None:
    """Refuse a way over skin that was not seen.

    Raises:
        PlanningError: Some of it was not.
    """
    if known.all():
        return
    unknown_B = skin.points(ab[~known])
    x, y = (ab[~known] @ towards_robot(skin).T).T
    sectors = _sectors(np.degrees(np.arctan2(y, x)))
    raise PlanningError(
        f"no skin was seen over {np.mean(~known):.0%} of {what}: {sectors} (0 degrees is towards "
        "the robot, counter-clockwise), first near "
        f"{np.round(unknown_B[0] * 1e3).astype(int).tolist()} mm in B: move the cameras, the light "
        "or the phantom so that all of it is seen",
        unknown_B,
    )


def _sectors(azimuths_deg: Float[np.ndarray, "n"]) -> str:
    """Azimuths as a list of the sectors that hold them."""
    whole = np.unique(np.floor(azimuths_deg / SECTOR_DEG).astype(int) % (360 // SECTOR_DEG))
    starts = whole[np.diff(whole, prepend=-2) > 1]
    ends = whole[np.diff(whole, append=10**6) > 1] + 1
    return ", ".join(
        f"{SECTOR_DEG * a} to {SECTOR_DEG * b} degrees" for a, b in zip(starts, ends, strict=True)
    )
