"""How far the arm and its tool stay from themselves, from their cell and from the body.

All hulls are simple (`geometry.hulls`), the arm's own among them (`geometry.arm_hulls`). The body
is what was seen of it: points on the skin, and the chest around and under them.

What the probe touches counts without its face: its hulls begin behind it. The tip is taken where
it presses, not where it meets the skin, and against the skin as it was seen. Only of the skin
around the tip nothing is counted: the face pushes it away.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Protocol, no_type_check, runtime_checkable

import numba
import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from breastscan.geometry import se3
from breastscan.geometry.arm_hulls import link_hulls
from breastscan.geometry.hulls import HullTable, Shape, hull_distance, placed_distance
from breastscan.geometry.kinematic_calibration import KinematicCalibration

LINKS = 6
MEASURED_UP_TO = 1.0
"""Distances beyond this are not told apart [m]."""
RUN = 16
"""Points of the skin that lie together are passed over together."""
CHEST_REACH = 0.3
"""How far from the middle of the breast the chest counts [m]: beyond, nobody has seen it."""
CHEST_STEPS = 5
"""Points along each edge of a hull that are held against the chest."""


@runtime_checkable
class Chest(Protocol):
    """What the breast stands on, as far as it is seen."""

    def heights(self, p: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Heights of points above it [m]."""
        ...

    def seen_from(self, X_AB: Float[np.ndarray, "4 4"]) -> "Chest":
        """The same of frame B, in frame A."""
        ...


@dataclass(frozen=True, kw_only=True)
class Body:
    """What was seen of the person, in B."""

    skin_B: Float[np.ndarray, "n 3"]
    """Points on the breast, some millimetres apart [m]."""
    chest: Chest
    """What it stands on."""

    @cached_property
    def runs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The skin's points in runs of neighbours [m], and the centre and radius of each run."""
        tree = KDTree(self.skin_B, leafsize=RUN)
        ordered_B = np.ascontiguousarray(self.skin_B[tree.indices])
        runs = [ordered_B[k : k + RUN] for k in range(0, len(ordered_B), RUN)]
        centres_B = np.array([run.mean(axis=0) for run in runs])
        radii = [
            np.linalg.norm(run - centre, axis=1).max()
            for run, centre in zip(runs, centres_B, strict=True)
        ]
        return ordered_B, centres_B, np.array(radii)

    def seen_from(self, X_AB: Float[np.ndarray, "4 4"]) -> "Body":
        """The same body, moved by a pose [m]."""
        skin_A = se3.transform(X_AB, self.skin_B)
        return Body(skin_B=skin_A, chest=self.chest.seen_from(X_AB))

    @cached_property
    def centre_B(self) -> Float[np.ndarray, "3"]:
        """The middle of the breast [m]."""
        return (self.skin_B.min(axis=0) + self.skin_B.max(axis=0)) / 2.0


@dataclass(frozen=True, kw_only=True)
class Closest:
    """The closest pair of an arm's shape and another shape."""

    distance: float
    """Gap between them, negative where they overlap [m]."""
    of_arm: str
    """Name of the arm's or tool's shape."""
    of_other: str
    """Name of the other shape, of the surroundings or of the arm itself."""


class Clearance:
    """Distances between the hulls of one arm, its tool and what stands around.

    Links that share a joint touch by design and are left out, as are base and first link over the
    table that they stand on.
    """

    def __init__(
        self,
        tool: Sequence[Shape] = (),
        room: Sequence[Shape] = (),
        arm: KinematicCalibration | None = None,
    ) -> None:
        """Collect the pairs.

        Args:
            tool: What the flange carries, placed in F.
            room: What stands around, placed in B.
            arm: The arm's own kinematics; None for the nominal arm's.
        """
        self._arm = arm or KinematicCalibration.nominal()
        self._body: Body | None = None
        links = [(number, hull) for number in range(1, LINKS + 1) for hull in link_hulls(number)]
        carried = [(LINKS, hull) for hull in tool]
        placed = [*links, *carried, *((0, hull) for hull in room)]
        self._hulls = [hull for _, hull in placed]
        self._links = np.array([link for link, _ in placed])
        self._tool = np.arange(len(links), len(links) + len(tool))
        self._arm_only = np.flatnonzero(self._links[: len(links)] > 1)
        self._X = np.array([hull.X for hull in self._hulls])
        self._X_FH = self._X[self._tool].copy()
        self._X[self._tool] = self._arm.X_6F @ self._X_FH
        self._table = HullTable.of(self._hulls).arrays
        self._pairs = self._apart()

    def __call__(self, q: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        """The minimum gap [m] at each row of joint angles [rad]; negative where hulls overlap."""
        return self._gaps(q)[0]

    def of(self, body: Body) -> "Clearance":
        """The same arm and room, and this body."""
        other = copy(self)
        other._body = body
        return other

    def with_body_moved(self, X: Float[np.ndarray, "4 4"]) -> "Clearance":
        """The same with the body moved by a pose [m]."""
        return self if self._body is None else self.of(self._body.seen_from(X))

    def closest(self, q: Float[np.ndarray, "6"]) -> Closest:
        """The closest pair with the joints at `q` [rad]."""
        gaps, pairs = self._gaps(q[None])
        arm, other = (self._hulls[k].name for k in self._pairs[pairs[0]])
        return Closest(distance=float(gaps[0]), of_arm=arm, of_other=other)

    def arm_to_body(self, q: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        """The minimum gap [m] between the arm's own hulls and the body, at joint angles [rad]."""
        nowhere = np.full((len(q), 3), np.inf)
        return self._to_body(self._poses(q)[:, self._arm_only], self._arm_only, nowhere, 0.0)

    def tool_to_body(
        self,
        X_BF: Float[np.ndarray, "n 4 4"],
        touched_B: Float[np.ndarray, "n 3"],
        yielding: float,
    ) -> Float[np.ndarray, "n"]:
        """The minimum gap [m] between what the flange carries and the body.

        Args:
            X_BF: Poses of the flange.
            touched_B: Where the skin is touched [m].
            yielding: Radius around there within which the skin yields and is not counted [m].
        """
        return self._to_body(X_BF[:, None] @ self._X_FH, self._tool, touched_B, yielding)

    def _to_body(
        self, X: np.ndarray, hulls: np.ndarray, touched_B: np.ndarray, yielding: float
    ) -> np.ndarray:
        """The minimum gap [m] of some hulls at poses `X`; what is not told apart without a body."""
        gaps = np.full(len(X), MEASURED_UP_TO)
        if self._body is not None:
            self._lower_to_chest(X, hulls, self._body, gaps)
            X, touched_B = np.ascontiguousarray(X), np.ascontiguousarray(touched_B)
            _lower_to_skin(X, hulls, self._table, *self._body.runs, touched_B, yielding, gaps)
        return gaps

    def _lower_to_chest(
        self, X: np.ndarray, hulls: np.ndarray, body: Body, gaps: np.ndarray
    ) -> None:
        """Lower gaps to the heights over the chest of points along the hulls' edges [m]."""
        _, _, _, edges, firsts, radii = self._table
        fractions = np.linspace(0.0, 1.0, CHEST_STEPS)[:, None, None]
        for k, hull in enumerate(hulls):
            ends = edges[firsts[hull] : firsts[hull + 1]]
            points = ((1.0 - fractions) * ends[:, 0] + fractions * ends[:, 1]).reshape(-1, 3)
            points = np.unique(points.round(9), axis=0)
            p_B = np.einsum("nij,pj->npi", X[:, k, :3, :3], points) + X[:, k, None, :3, 3]
            away = np.linalg.norm(p_B - body.centre_B, axis=-1)
            heights = np.where(away < CHEST_REACH, body.chest.heights(p_B), np.inf)
            np.minimum(gaps, heights.min(axis=1) - radii[hull], out=gaps)

    def _apart(self) -> np.ndarray:
        """Pairs of rows that must keep apart: more than a joint between them, or arm and room."""
        arm, room = np.flatnonzero(self._links > 0), np.flatnonzero(self._links == 0)
        moving = np.flatnonzero(self._links > 1)
        pairs = [
            (i, j)
            for i, j in combinations(arm.tolist(), 2)
            if abs(self._links[i] - self._links[j]) > 1
        ]
        pairs += product(moving.tolist(), room.tolist())
        return np.array(pairs, dtype=int).reshape(-1, 2)

    def _gaps(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _closest_pairs(self._poses(q), self._table, self._pairs, MEASURED_UP_TO)

    def _poses(self, q: np.ndarray) -> np.ndarray:
        """Poses of all hulls in B, a row a posture."""
        frames = np.concatenate(
            [np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), self._arm.link_frames(q)], axis=1
        )
        return np.ascontiguousarray(frames[:, self._links] @ self._X)


@numba.njit(cache=True)
@no_type_check  # keeps the tests' run-time type checker from wrapping what numba compiles
def _closest_pairs(X, table, pairs, up_to):
    """The minimum gap of each posture [m], and the pair that has it."""
    gaps = np.full(len(X), up_to)
    which = np.zeros(len(X), np.int64)
    for n in range(len(X)):
        for k in range(len(pairs)):
            i, j = pairs[k]
            gap = hull_distance(table, i, X[n, i], j, X[n, j], gaps[n])
            if gap < gaps[n]:
                gaps[n] = gap
                which[n] = k
    return gaps, which


@numba.njit(cache=True)
@no_type_check
def _lower_to_skin(X, hulls, table, skin_B, centres_B, radii, touched_B, yielding, gaps):
    """Lower gaps to those between hulls and the points of the skin [m]."""
    kinds, sizes, _, _, _, _ = table
    for n in range(len(X)):
        tx, ty, tz = touched_B[n]
        for k in range(len(hulls)):
            kind, size = kinds[hulls[k]], sizes[hulls[k]]
            X_k = X[n, k]
            for r in range(len(centres_B)):
                x, y, z = centres_B[r]
                if placed_distance(kind, size, X_k, x, y, z) - radii[r] >= gaps[n]:
                    continue
                for m in range(r * RUN, min((r + 1) * RUN, len(skin_B))):
                    x = skin_B[m, 0]
                    y = skin_B[m, 1]
                    z = skin_B[m, 2]
                    if (x - tx) ** 2 + (y - ty) ** 2 + (z - tz) ** 2 < yielding**2:
                        continue
                    gap = placed_distance(kind, size, X_k, x, y, z)
                    gaps[n] = min(gaps[n], gap)
