"""Strokes that together touch all of a breast's skin but margins around the nipple and at the base.

Every stroke is a curve in a flat map of the skin: polar coordinates about the nipple's tip, whose
radius is the length along the meridian and whose angle the azimuth. Lengths around the breast are
shorter on the skin than in the map, so strokes that lie a swath apart in it leave no gap.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import REACH, Skin
from breastscan.planning import pattern, probe_poses
from breastscan.planning.pattern import Kind, Path

AZIMUTHS = 2.0 * np.pi * np.arange(90) / 90
"""At which it is looked how low the probe may go [rad]."""
LOWER = 0.6
"""Share of the breast's height below which the chest may be in the way [-]."""
SMOOTHING = 2.0
"""Standard deviation of the average over their lowest places, in steps between them."""
STEPS = 400
"""Of a meridian, from the tip outwards."""
POINT_SPACING = 0.008
"""Between the points of a stroke [m]."""
FEWEST_POINTS = 8
TWICE_CLOSER = 0.8
"""Distance of loops that are to touch everything twice, over that of those that do so once [-]: a
loaded loop is far wider than its swath where skin is bent, which is all but next to the chest."""
ALONG = ("loops", "spiral", "radial")
"""Patterns whose strokes have the array along them."""
SAMPLES = 400
"""Of a track from which those are chosen."""

Clear = Callable[[Float[np.ndarray, "n 4 4"]], Bool[np.ndarray, "n"]]
"""Whether the probe, its tip on the skin at these poses, keeps clear of the body."""


@dataclass(frozen=True, kw_only=True)
class CoverageConfig:
    """What an examination touches, and how densely."""

    nipple_margin: float = 0.010
    """Distance from the nipple's tip within which no skin need be touched [m]."""
    base_margin: float = 0.010
    """Height over the chest below which none need be [m]."""
    overlap: float = 0.1
    """Share of a stroke's swath that the next touches again [-]."""
    twice: bool = False
    """Whether every place is to be touched by two strokes."""

    def __post_init__(self) -> None:
        require_positive(self, "planning.coverage", but=("overlap",))
        if not 0.0 <= self.overlap <= 0.8:
            raise ConfigError(
                f"planning.coverage.overlap must lie between 0 and 0.8, not {self.overlap}",
                self.overlap,
            )


@dataclass(frozen=True)
class Patch:
    """What the pressed probe touches at a time."""

    length: float
    """Along the array [m]."""
    width: float
    """Across it [m]."""


@dataclass(frozen=True)
class Track:
    """A stroke in the map."""

    fraction: Float[np.ndarray, "n"]
    """Of the way from the first length of a band to its last, at each point."""
    azimuth: Float[np.ndarray, "n"]
    """About the nipple's tip, counter-clockwise from the robot's side [rad]."""
    closed: bool = False
    array_along: bool = False
    back: bool = False
    """Whether it is followed back as well, by a stroke of its own."""

    @property
    def reversed(self) -> "Track":
        """The way back alone."""
        there = replace(self, fraction=self.fraction[::-1], azimuth=self.azimuth[::-1])
        return replace(there, back=False)

    @property
    def _length(self) -> int:
        """Its points, less one; round a closed track there is one more step."""
        return len(self.fraction) - (not self.closed)

    def at(self, share: Float[np.ndarray, "m"]) -> "Track":
        """An open track through places of this one, at shares of its evenly spaced points [-];
        beyond 1 a closed one goes on.
        """
        fraction, azimuth = self.fraction, self.azimuth
        if self.closed:
            turn = math.copysign(2.0 * math.pi, azimuth[-1] - azimuth[0])
            fraction = np.concatenate([fraction, fraction, fraction[:1]])
            azimuth = np.concatenate([azimuth, azimuth + turn, azimuth[:1] + 2.0 * turn])
        places, at = np.arange(len(fraction)), share * self._length
        return replace(
            self,
            fraction=np.interp(at, places, fraction),
            azimuth=np.interp(at, places, azimuth),
            closed=False,
        )

    def part(self, begin: float, end: float) -> "Track":
        """An open piece of it, between shares of its evenly spaced points [-]."""
        points = max(round((end - begin) * self._length) + 1, FEWEST_POINTS)
        return self.at(np.linspace(begin, end, points))


@dataclass(frozen=True, kw_only=True)
class Band:
    """A breast's skin between a first length along every meridian, and a last one."""

    skin: Skin
    top_ab: Float[np.ndarray, "2"]
    """Where the nipple's tip is in the skin's chart [rad]."""
    first: float
    """Length from the nipple's tip [m]."""
    last: Float[np.ndarray, "a"]
    """The same at `AZIMUTHS` [m]."""

    @staticmethod
    def reached(
        skin: Skin, plate: Plane, config: CoverageConfig, width: float, clear: Clear
    ) -> "Band":
        """Where the middle of the patch may go: half of its width inside of the margins, and clear
        of the body.

        Args:
            skin: The breast's, in B.
            plate: Where heights count from, in B.
            config: The margins.
            width: Of what the probe touches, along the meridian [m].
            clear: Whether poses are clear of the body, told with the array along the chest.

        Raises:
            PlanningError: Nothing is left between the margins.
        """
        net = _Meridians(skin, pattern.top(skin, plate), AZIMUTHS)
        s, heights = net.s, plate.heights(net.points_B)
        out = np.linalg.norm(net.points_B - net.points_B[:, :1], axis=2) > config.nipple_margin
        first = float(s[:, 1:][out[:, 1:]].min()) if out.any() else math.inf
        low = net.first_length(heights < config.base_margin) - width / 2
        first += width / 2
        inside = (s >= first) & (heights < LOWER * heights[:, :1])
        barred = inside & ~net.known
        barred[inside] |= ~clear(net.poses(plate.normal)[inside])
        low = np.minimum(low, net.first_length(barred) - s[:, 1].max())
        smooth = gaussian_filter1d(minimum_filter1d(low, 3, mode="wrap"), SMOOTHING, mode="wrap")
        low = smooth - max(float((smooth - low).max()), 0.0)
        if not low.min() > first:
            place = np.degrees(AZIMUTHS[np.argmin(low)])
            raise PlanningError(
                f"no room for a stroke {width * 1e3:.0f} mm wide between the margins of nipple and "
                f"base {place:.0f} degrees from the robot's side: the probe can go "
                f"{low.min() * 1e3:.0f} mm from the nipple's tip there and has to keep "
                f"{first * 1e3:.0f} mm away from it; scan a single loop, or choose smaller margins",
                place,
            )
        return Band(skin=skin, top_ab=net.top_ab, first=first, last=low)

    def path(self, track: Track) -> Path:
        """Where a track runs on the skin.

        Raises:
            PlanningError: Skin was not seen there.
        """
        path = pattern.path_on(self.skin, self._chart(track), closed=track.closed)
        return replace(path, array_along=track.array_along)

    def seen(self, track: Track) -> list[Track]:
        """The pieces of a track on skin that was seen: most often the whole of it."""
        known = self._known(track)
        if known.all():
            return [track]
        if track.closed:
            unseen = np.argmin(known) / (SAMPLES - 1)
            track = track.part(unseen, unseen + 1.0)
            known = self._known(track)
        known = minimum_filter1d(known.astype(np.uint8), 3).astype(bool)
        runs = np.split(np.arange(SAMPLES), np.flatnonzero(np.diff(known)) + 1)
        shares = [run[[0, -1]] / (SAMPLES - 1) for run in runs if known[run[0]]]
        return [track.part(begin, end) for begin, end in shares if end > begin]

    def _known(self, track: Track) -> Bool[np.ndarray, "m"]:
        """Whether skin was seen, at even shares of a track."""
        return self.skin.known(self._chart(track.at(np.linspace(0.0, 1.0, SAMPLES))))

    def _chart(self, track: Track) -> Float[np.ndarray, "n 2"]:
        """Where a track runs in the skin's chart [rad]."""
        s = self.first + track.fraction * (self.lowest(track.azimuth) - self.first)
        return _Meridians(self.skin, self.top_ab, track.azimuth).at(s)

    def lowest(self, azimuth: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The last length at azimuths [rad]."""
        return np.interp(azimuth, AZIMUTHS, self.last, period=2.0 * np.pi)

    def located(
        self, p_B: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Length from the nipple's tip [m] and azimuth [rad] of places near the skin."""
        out = (self.skin.chart(p_B) - self.top_ab) @ pattern.towards_robot(self.skin).T
        azimuth = np.arctan2(out[:, 1], out[:, 0])
        return _Meridians(self.skin, self.top_ab, azimuth).length_at(np.hypot(*out.T)), azimuth

    def length_around(self, fraction: float) -> float:
        """Of the skin around the breast [m]."""
        points_B = self.path(Track(np.full(len(AZIMUTHS), fraction), AZIMUTHS)).points_B
        return float(np.linalg.norm(points_B - np.roll(points_B, 1, axis=0), axis=1).sum())

    @property
    def depth(self) -> float:
        """The longest way from the first length to the last [m]."""
        return float(self.last.max() - self.first)


def swath(kind: Kind, patch: Patch) -> float:
    """Width of what a stroke of this pattern touches [m]."""
    return patch.width if kind in ALONG else patch.length


def depth(kind: Kind, patch: Patch) -> float:
    """Length of what a stroke of this pattern touches at a time along the meridian [m]."""
    return patch.length if kind == "radial" else patch.width


def tracks(kind: Kind, band: Band, spacing: float, *, twice: bool = False) -> list[Track]:
    """The strokes of a pattern in the map, each beginning near the end of the one before.

    `loops` and the turns of a `spiral` go round with the array along them, from the chest up, where
    the arm has the least choice, every other one the other way, so that joint 6 unwinds; `radial`
    and `antiradial` strokes run along meridians, the array along or across, and a `raster` to and
    fro, the array across.

    Args:
        kind: Which, but a single loop.
        band: Where.
        spacing: From stroke to stroke [m].
        twice: Whether every place is to be touched by two strokes: loops at the margins, which have
            one neighbour, are followed back as well, and all lie `TWICE_CLOSER`; other strokes lie
            half as far apart.
    """
    if twice:
        spacing *= TWICE_CLOSER if kind == "loops" else 0.5
    found, along = _TRACKS[kind](band, spacing), kind in ALONG
    ends = (0, len(found) - 1) if twice and kind == "loops" else ()
    return [replace(one, array_along=along, back=k in ends) for k, one in enumerate(found)]


def _loops(band: Band, spacing: float) -> list[Track]:
    count = math.ceil(band.depth / spacing) + 1
    tracks = []
    for k, fraction in enumerate(np.linspace(1.0, 0.0, count)):
        points = _points(band.length_around(fraction))
        azimuth = (-1) ** k * 2.0 * np.pi * np.arange(points) / points
        tracks.append(Track(np.full(points, fraction), azimuth, closed=True))
    return tracks


def _spiral(band: Band, spacing: float) -> list[Track]:
    """A turn along either margin, and between them those of a spiral."""
    turns = math.ceil(band.depth / spacing)
    ends = [(1.0, 1.0), *((1 - k / turns, 1 - (k + 1) / turns) for k in range(turns)), (0.0, 0.0)]
    tracks = []
    for k, (begin, end) in enumerate(ends):
        points = _points(band.length_around((begin + end) / 2)) + 1
        track = Track(np.linspace(begin, end, points), np.linspace(0.0, 2.0 * np.pi, points))
        tracks.append(track.reversed if k % 2 else track)
    return tracks


def _meridians(band: Band, spacing: float) -> list[Track]:
    count = math.ceil(band.length_around(1.0) / spacing)
    out = np.linspace(0.0, 1.0, SAMPLES)
    return [
        _evenly(band, Track(out[:: (-1) ** k], np.full(SAMPLES, 2.0 * np.pi * k / count)))
        for k in range(count)
    ]


def _raster(band: Band, spacing: float) -> list[Track]:
    widest = float(band.last.max())
    count = math.ceil(2.0 * widest / spacing) + 1
    along, tracks = np.linspace(-widest, widest, SAMPLES), []
    for k, aside in enumerate(np.linspace(-widest, widest, count)):
        x = along[:: (-1) ** k]
        azimuth = np.unwrap(np.arctan2(aside, x))
        fraction = (np.hypot(x, aside) - band.first) / (band.lowest(azimuth) - band.first)
        inside = (fraction >= 0.0) & (fraction <= 1.0)
        for piece in np.split(np.arange(SAMPLES), np.flatnonzero(np.diff(inside)) + 1):
            if inside[piece[0]] and np.ptp(x[piece]) > spacing:
                tracks.append(_evenly(band, Track(fraction[piece], azimuth[piece])))
    return tracks


def _points(length: float) -> int:
    """Of a stroke so long around the breast [m]."""
    return max(math.ceil(length / POINT_SPACING), FEWEST_POINTS)


def _evenly(band: Band, dense: Track) -> Track:
    """An open track whose points are evenly spaced on the skin."""
    s = probe_poses.lengths(band.path(dense).points_B)
    even = np.linspace(0.0, s[-1], max(math.ceil(s[-1] / POINT_SPACING) + 1, FEWEST_POINTS))
    return replace(
        dense,
        fraction=np.interp(even, s, dense.fraction),
        azimuth=np.interp(even, s, dense.azimuth),
    )


_TRACKS: dict[Kind, Callable[[Band, float], list[Track]]] = {
    "loops": _loops,
    "spiral": _spiral,
    "radial": _meridians,
    "antiradial": _meridians,
    "raster": _raster,
}


class _Meridians:
    """The skin along curves of constant azimuth about the nipple's tip."""

    def __init__(self, skin: Skin, top_ab: np.ndarray, azimuths: np.ndarray) -> None:
        self._skin = skin
        self.top_ab = top_ab
        self._out = np.column_stack([np.cos(azimuths), np.sin(azimuths)]) @ pattern.towards_robot(
            skin
        )
        self._t = np.linspace(0.0, REACH, STEPS)

    @cached_property
    def _ab(self) -> np.ndarray:
        return self.top_ab + self._t[:, None] * self._out[:, None]

    @cached_property
    def points_B(self) -> np.ndarray:
        """Of every meridian, from the tip outwards [m]."""
        return self._skin.points(self._ab.reshape(-1, 2)).reshape(*self._ab.shape[:2], 3)

    @cached_property
    def s(self) -> np.ndarray:
        """Length up to each [m]."""
        steps = np.linalg.norm(np.diff(self.points_B, axis=1), axis=2)
        return np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)

    @cached_property
    def known(self) -> np.ndarray:
        """Where skin was seen."""
        return self._skin.known(self._ab.reshape(-1, 2)).reshape(self._ab.shape[:2])

    def at(self, s: np.ndarray) -> np.ndarray:
        """The chart's coordinates at a length of every meridian [rad]."""
        t = [np.interp(one, row, self._t) for one, row in zip(s, self.s, strict=True)]
        return self.top_ab + np.array(t)[:, None] * self._out

    def length_at(self, t: np.ndarray) -> np.ndarray:
        """Length of every meridian at a distance from the tip in the chart [rad]."""
        return np.array([np.interp(one, self._t, row) for one, row in zip(t, self.s, strict=True)])

    def first_length(self, there: np.ndarray) -> np.ndarray:
        """Length at which each meridian is first so; its end where it never is [m]."""
        there = there.copy()
        there[:, -1] = True
        return self.s[np.arange(len(there)), np.argmax(there, axis=1)]

    def poses(self, up_B: np.ndarray) -> np.ndarray:
        """Of the probe on every point, its array across the chest's normal."""
        z_B = -self._skin.normals(self._ab.reshape(-1, 2))
        x_B = np.cross(up_B, z_B)
        x_B /= np.maximum(np.linalg.norm(x_B, axis=1, keepdims=True), 1e-9)
        rotation = np.stack([x_B, np.cross(z_B, x_B), z_B], axis=-1)
        return se3.pose(rotation, self.points_B.reshape(-1, 3)).reshape(*self._ab.shape[:2], 4, 4)
