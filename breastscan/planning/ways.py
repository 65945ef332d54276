"""The ways of the arm to its strokes, between them, and home."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import free_way
from breastscan.planning.fitting import Task
from breastscan.planning.free_way import STRAIGHT, Joints, Way
from breastscan.planning.motion import Motion, joined

RISE, RISE_STEP = 0.2, 0.02
"""How far the probe is raised off the chest, where it can be, before a way around is sought, and in
which steps [m]."""
TURNS = 4
"""Ways in which the joints of a group may be turned that are tried with ways around."""


def connected(
    strokes: Sequence[Motion], task: Task, q_home: Joints
) -> tuple[Motion, Sequence[int]]:
    """Strokes one after the other, with the ways from home to the first, between them, and home.

    Strokes that straight ways join are one group, their joints turned by whole rotations to where
    the one before has left them; a group is turned so that ways lead to it and home from it. One
    that none does in any of its turns is left out: in its posture the arm is shut in.

    Args:
        strokes: Of one path each.
        task: What they were planned with.
        q_home: Where the arm comes from, and goes to in the end [rad].

    Returns:
        The motion, and which strokes are in it.

    Raises:
        PlanningError: There is no free way to any of them.
    """
    space, groups = _Space(task, strokes[0]), []
    left_out = PlanningError("no strokes")
    for numbers, group in space.groups(strokes):
        try:
            groups.append((numbers, space.reached(group, q_home)))
        except PlanningError as error:
            left_out = error
    if not groups:
        raise left_out
    (_, first), *_ = groups
    ways = [first.there]
    for (_, before), (_, after) in pairwise(groups):
        ways += [STRAIGHT] * (len(before.strokes) - 1)
        ways.append(space.between(before, after, q_home))
    _, last = groups[-1]
    ways += [*[STRAIGHT] * (len(last.strokes) - 1), last.back]
    whole = joined([stroke for _, group in groups for stroke in group.strokes])
    return replace(whole, ways=tuple(ways)), [k for numbers, _ in groups for k in numbers]


def entered(motion: Motion, task: Task, stroke: int, q_now: Joints) -> Motion:
    """The motion of an arm that comes to a stroke from elsewhere [rad].

    Raises:
        PlanningError: There is no free way.
    """
    if task.clearance is None:
        return motion
    space = _Space(task, motion)
    way_in = space.way(q_now, space.above(motion, motion.starts[stroke]))
    return replace(motion, ways=(*motion.ways[:stroke], way_in, *motion.ways[stroke + 1 :]))


@dataclass(frozen=True)
class _Group:
    """Strokes that straight ways join."""

    strokes: list[Motion]
    begin: Joints
    """Clear of the skin above the first row [rad]."""
    end: Joints
    """Above the last."""
    there: Way = STRAIGHT
    """From home."""
    back: Way = STRAIGHT

    def turned(self, rotations: Joints) -> "_Group":
        """With all joints turned [rad]."""
        return replace(
            self,
            strokes=[
                replace(stroke, q=stroke.q + rotations, q_approach=stroke.q_approach + rotations)
                for stroke in self.strokes
            ],
            begin=self.begin + rotations,
            end=self.end + rotations,
        )


class _Space:
    """What the arm moves in."""

    def __init__(self, task: Task, like: Motion) -> None:
        self._task, up_B = task, like.chest_normal_B
        self._arm = task.calibration or KinematicCalibration.nominal()
        self._limits = task.config.reachable_angles
        self._up_B = np.zeros(3) if up_B is None else up_B

    def above(self, motion: Motion, row: int) -> Joints:
        """The arm clear of the skin above a row [rad]."""
        return motion.lifted(row, self._task.X_FP, self._arm)

    def groups(self, strokes: Sequence[Motion]) -> Iterator[tuple[list[int], _Group]]:
        """Numbers of strokes, and these as a group."""
        numbers, found = [], []
        for number, stroke in enumerate(strokes):
            near = stroke.turned(found[-1].q[-1], self._limits) if found else stroke
            if found and not self._straight(found[-1], near):
                yield numbers, self._group(found)
                numbers, found = [], []
            numbers.append(number)
            found.append(near)
        yield numbers, self._group(found)

    def reached(self, group: _Group, q_home: Joints) -> _Group:
        """The group in the first of its turns to which ways lead from home, and back.

        Raises:
            PlanningError: None do.
        """
        turned = [group.turned(rotations) for rotations in self._rotations(group, q_home)]
        if self._task.clearance is None:
            return turned[0]
        for one in turned:
            if self._free(q_home, one.begin) and self._free(one.end, q_home):
                return one
        error = None
        for one in turned[:TURNS]:
            try:
                there, back = self.way(q_home, one.begin), self.way(one.end, q_home)
            except PlanningError as why:
                error = why
            else:
                return replace(one, there=there, back=back)
        raise error or PlanningError("the arm can turn to none of the strokes", group)

    def between(self, before: _Group, after: _Group, q_home: Joints) -> Way:
        """From group to group, over home where no shorter way is found."""
        over = (*before.back, q_home, *after.there)
        if self._task.clearance is None:
            return STRAIGHT
        try:
            direct = self.way(before.end, after.begin)
        except PlanningError:
            return over
        begin, end = before.end, after.begin
        return min(direct, over, key=lambda way: free_way.duration([begin, *way, end]))

    def way(self, begin: Joints, end: Joints) -> Way:
        """`free_way.way`, sought from off the chest.

        Raises:
            PlanningError: There is none.
        """
        return free_way.way(begin, end, self._gap, self._limits, self._risen)

    @cached_property
    def _gap(self) -> free_way.Gap:
        assert self._task.clearance is not None
        return free_way.gap_of(self._task.clearance, self._arm)

    def _group(self, strokes: list[Motion]) -> _Group:
        last = strokes[-1]
        return _Group(strokes, self.above(strokes[0], 0), self.above(last, len(last.q) - 1))

    def _straight(self, before: Motion, after: Motion) -> bool:
        """Whether the straight way from one stroke to another is free."""
        if self._task.clearance is None:
            return True
        return self._free(self.above(before, len(before.q) - 1), self.above(after, 0))

    def _free(self, begin: Joints, end: Joints) -> bool:
        """Whether the straight way is."""
        return free_way.keeping(self._gap, begin, end)(begin, end)

    def _rotations(self, group: _Group, q_home: Joints) -> list[Joints]:
        """Whole rotations of the joints that keep all of a group inside the limits, those first
        that leave the arm nearest to home [rad].
        """
        q = np.concatenate([stroke.q for stroke in group.strokes])
        turns = 2.0 * np.pi * np.arange(-2, 3)
        inside = [
            turns[(low + turns >= -limit) & (high + turns <= limit)]
            for low, high, limit in zip(q.min(axis=0), q.max(axis=0), self._limits, strict=True)
        ]
        found = [np.array(rotations) for rotations in product(*inside)]
        return sorted(found, key=lambda by: float(np.abs(group.begin + by - q_home).max()))

    def _risen(self, q: Joints) -> list[Joints]:
        """From a posture off the chest, as far as the arm can."""
        chain, X_BF = [q], self._arm.forward(q)
        for rise in np.arange(RISE_STEP, RISE, RISE_STEP):
            X_risen = se3.pose(X_BF[:3, :3], X_BF[:3, 3] + rise * self._up_B)
            higher = self._arm.refined(chain[-1], X_risen)
            if not np.isfinite(higher).all():
                break
            chain.append(higher)
        return chain
