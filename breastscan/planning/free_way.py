"""A way of the arm through free space: straight in joint space where that is clear of body, arm and
room, and otherwise around what stands there [Kuffner, LaValle: RRT-Connect, ICRA 2000], cut short
afterwards.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.clearance import Clearance

MARGIN = 0.01
"""Smallest gap on a way [m]; close to its ends, where it begins or ends nearer to something,
that."""
CLOSE = 0.15
"""Of the joint that is farthest from where it is at an end [rad]."""
SLACK = 1e-3
"""By which a way may come nearer than its ends [m]."""
LOOK = 0.02
"""Between two looks on a way, of the joint that moves most [rad]: 16 mm at full reach, of which no
place is farther than 8 mm from a look."""
STEP = 0.4
"""By which a tree grows [rad]."""
AROUND = 1.5
"""How far beyond both ends a joint may swing out [rad]."""
COARSE = 5
"""One look in so many is taken first: most ways that are not free are found out by these."""
TRIES = 1000
"""Postures drawn before a way is given up."""
SHORTCUTS = 60
"""Pairs of places on a way that are tried to be joined straight."""

Joints = Float[np.ndarray, "6"]
Free = Callable[[Joints, Joints], bool]
"""Whether the straight way from one posture to another is."""
Risen = Callable[[Joints], Sequence[Joints]]
"""Postures from one on, away from what lies close to it."""
Way = tuple[Joints, ...]
"""Postures between which the arm moves straight in joint space [rad]."""
STRAIGHT: Way = ()
Gap = Callable[[Float[np.ndarray, "n 6"]], Float[np.ndarray, "n"]]
"""Smallest distance to anything, at joint angles [rad] [m]."""


def gap_of(clearance: Clearance, arm: KinematicCalibration) -> Gap:
    """What measures how far the whole arm stays from itself, the room and the body."""

    def gap(q: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        nowhere = np.full((len(q), 3), np.inf)
        to_body = clearance.tool_to_body(arm.forward(q), nowhere, 0.0)
        return np.minimum.reduce([clearance(q), clearance.arm_to_body(q), to_body])

    return gap


def way(begin: Joints, end: Joints, gap: Gap, limits: Joints, risen: Risen = lambda q: [q]) -> Way:
    """Postures between which the arm moves straight in joint space from one to another [rad]: none
    where the straight way is free.

    Args:
        begin: Where it begins [rad].
        end: Where it ends [rad].
        gap: What it keeps from.
        limits: Largest angle of each joint [rad].
        risen: From where to begin to look for one.

    Raises:
        PlanningError: None was found.
    """
    free = keeping(gap, begin, end)
    if free(begin, end):
        return STRAIGHT
    rng = np.random.default_rng(0)
    low = np.maximum(np.minimum(begin, end) - AROUND, -limits)
    high = np.minimum(np.maximum(begin, end) + AROUND, limits)
    near, far = (_Tree(_free_chain(risen(q), free)) for q in (begin, end))
    for _ in range(TRIES):
        reached = near.grown(rng.uniform(low, high), free)
        if reached is not None and far.joined(reached, free):
            there, back = near.branch(), far.branch()
            if near.root is not begin:
                there, back = back, there
            return tuple(_cut_short(np.array([*there, *back[::-1][1:]]), free, rng)[1:-1])
        near, far = far, near
    raise PlanningError(
        "the arm finds no way clear of body, arm and room from "
        f"{np.degrees(begin).round().astype(int).tolist()} to "
        f"{np.degrees(end).round().astype(int).tolist()} degrees of its joints: give it more room, "
        "or park it elsewhere",
        (begin, end),
    )


class _Tree:
    """Postures that free straight ways join to one."""

    def __init__(self, chain: Sequence[Joints]) -> None:
        """Begin with postures that follow one another from the first on."""
        self.root = chain[0]
        self._nodes, self._from = np.empty((TRIES * 8, 6)), []
        for posture in chain:
            self._add(posture, len(self._from) - 1)

    def grown(self, towards: Joints, free: Free) -> Joints | None:
        """A step from the nearest posture, or None where that is not free."""
        away = np.linalg.norm(self._nodes[: len(self._from)] - towards, axis=1)
        nearest = int(away.argmin())
        node, distance = self._nodes[nearest], float(away[nearest])
        reached = towards if distance <= STEP else node + STEP / distance * (towards - node)
        if len(self._from) == len(self._nodes) or not free(node, reached):
            return None
        self._add(reached, nearest)
        return reached

    def joined(self, posture: Joints, free: Free) -> bool:
        """Whether steps lead all the way to a posture."""
        reached = self.grown(posture, free)
        while reached is not None and reached is not posture:
            reached = self.grown(posture, free)
        return reached is not None

    def branch(self) -> list[Joints]:
        """From the root to the posture that came last."""
        at, found = len(self._from) - 1, []
        while at >= 0:
            found.append(self._nodes[at].copy())
            at = self._from[at]
        return found[::-1]

    def _add(self, posture: Joints, before: int) -> None:
        self._nodes[len(self._from)] = posture
        self._from.append(before)


def _cut_short(
    places: Float[np.ndarray, "n 6"],
    free: Free,
    rng: np.random.Generator,
) -> Float[np.ndarray, "m 6"]:
    """A way without the detours that chance has made: between any two of its places it goes
    straight where that is free.
    """
    for _ in range(SHORTCUTS):
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        first, second = np.sort(rng.uniform(0.0, along[-1], 2))
        ends = np.array([[np.interp(at, along, column) for column in places.T]
                         for at in (first, second)])  # fmt: skip
        if free(ends[0], ends[1]):
            places = np.concatenate([places[along < first], ends, places[along > second]])
    kept = [places[0]]
    at = 0
    while at < len(places) - 1:
        at = next(k for k in range(len(places) - 1, at, -1)
                  if k == at + 1 or free(places[at], places[k]))  # fmt: skip
        kept.append(places[at])
    return np.array(kept)


def keeping(gap: Gap, begin: Joints, end: Joints) -> Free:
    """Whether ways keep their margin: close to their ends no larger a one than these have."""
    least = np.minimum(MARGIN, gap(np.stack([begin, end])) - SLACK)

    def kept(q: Float[np.ndarray, "n 6"]) -> bool:
        close = [np.abs(q - at).max(axis=1) < CLOSE for at in (begin, end)]
        margins = [
            np.where(near, margin, MARGIN) for near, margin in zip(close, least, strict=True)
        ]
        return bool((gap(q) > np.minimum(*margins)).all())

    def free(first: Joints, second: Joints) -> bool:
        looks = _looks(first, second)
        return kept(looks[::-COARSE]) and kept(looks)

    return free


def duration(places: Sequence[Joints]) -> float:
    """Of a way, in units of the top joint speed [rad]."""
    return float(np.abs(np.diff(places, axis=0)).max(axis=1).sum())


def _free_chain(chain: Sequence[Joints], free: Free) -> Sequence[Joints]:
    """A chain as far as it is free."""
    blocked = (k for k, (a, b) in enumerate(pairwise(chain), 1) if not free(a, b))
    return chain[: next(blocked, len(chain))]


def _looks(first: Joints, second: Joints) -> Float[np.ndarray, "n 6"]:
    """Where a straight way is looked at, both ends among them."""
    return np.linspace(first, second, int(np.ceil(np.abs(second - first).max() / LOOK)) + 1)
