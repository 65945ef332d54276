"""What a path may give way by where the arm cannot follow it, and what would help where that is not
enough.

In this order: the probe rolls about its axis, it leans away from the normal (both in
`planning.redundancy`), and the path moves up the skin. A refusal says what was tried in vain, and a
place of the phantom that was tried with success.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import motion
from breastscan.planning.clearance import Clearance
from breastscan.planning.feedrate import Feed, FeedrateLimits
from breastscan.planning.joint_limits import Corrections, JointPathConfig
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path
from breastscan.planning.roll_graph import BlockedError

PLACES = tuple(
    (f"{distance * 1e3:.0f} mm {where}", distance * np.array(direction))
    for distance in (0.03, 0.08)
    for where, direction in (
        ("farther from the robot's base", (1.0, 0.0, 0.0)),
        ("nearer to the robot's base", (-1.0, 0.0, 0.0)),
        ("to the left, seen from the base,", (0.0, 1.0, 0.0)),
        ("to the right, seen from the base,", (0.0, -1.0, 0.0)),
        ("higher", (0.0, 0.0, 1.0)),
    )
)
"""Where else the phantom is tried, the nearest first: in words, and by what in B [m]. It lies where
the base's x axis points."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """All that a motion is planned with but its path."""

    X_FP: Float[np.ndarray, "4 4"]
    """Probe tip in the flange."""
    period: float
    """Control period [s]."""
    limits: FeedrateLimits
    """What the motion along the curve keeps to."""
    config: JointPathConfig
    """What the joints keep to."""
    clearance: Clearance | None = None
    """What is kept clear of; None leaves that out."""
    corrections: Corrections | None = None
    """What the controller may add; None leaves that out."""
    calibration: KinematicCalibration | None = None
    """The arm's own kinematics; None for the nominal arm's."""
    q_before: Float[np.ndarray, "6"] | None = None
    """Joint angles that the arm comes from [rad]; None for wherever."""

    def plan(self, path: Path) -> tuple[Motion, Feed]:
        """`motion.plan_motion` along a path."""
        return motion.plan_motion(
            path, self.X_FP, self.period, self.limits, self.config,
            clearance=self.clearance, corrections=self.corrections, calibration=self.calibration,
            q_before=self.q_before,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A path that the arm can follow, and how."""

    path: Path
    motion: Motion
    feed: Feed
    rise: float
    """How far the path moved up for it [m]."""

    @property
    def told(self) -> str | None:
        """What it gave way by, as a sentence; None where by nothing."""
        ways = []
        if self.motion.largest_tilt > 0.0:
            degrees = np.degrees(self.motion.largest_tilt)
            ways.append(f"the probe leans from the normal by up to {degrees:.1f} degrees")
        if self.rise > 0.0:
            ways.append(f"the path lies {self.rise * 1e3:.0f} mm higher than asked for")
        told = f"To keep the arm's limits and clear of the body, {' and '.join(ways)}."
        return told if ways else None


def fit(path_at: Callable[[float], Path], rises: Sequence[float], task: Task) -> Fitted:
    """The motion along the first path that the arm can follow.

    Args:
        path_at: The path, moved up the skin by so much [m].
        rises: What is tried, in this order; 0 comes first [m].
        task: What it is planned with.

    Raises:
        PlanningError: The path cannot be followed, however it gives way.
    """
    first: PlanningError | None = None
    for rise in rises:
        path = path_at(rise)
        try:
            planned, feed = task.plan(path)
        except PlanningError as error:
            first = first or error
            continue
        return Fitted(path=path, motion=planned, feed=feed, rise=rise)
    assert first is not None, "0 comes first"
    if not isinstance(first, BlockedError):  # the path's own fault, wherever it lies
        raise first
    tried = [f"leaning the probe by up to {np.degrees(task.config.largest_tilt):.0f} degrees"]
    if max(rises) > 0.0:
        tried.append(f"a path up to {max(rises) * 1e3:.0f} mm higher")
    raise PlanningError(
        f"{first}; tried in vain: {' and '.join(tried)}; {_other_place(path_at(0.0), task)}",
        first.value,
    ) from first


def _other_place(path: Path, task: Task) -> str:
    """Where the phantom would have to lie, tried; or that no place helps."""
    upright = replace(task.config, largest_tilt=0.0)
    for where, offset_B in PLACES:
        X = se3.pose(np.eye(3), offset_B)
        clearance = None if task.clearance is None else task.clearance.with_body_moved(X)
        moved = Path(
            points_B=path.points_B + offset_B, normals_B=path.normals_B, closed=path.closed
        )
        try:
            replace(task, clearance=clearance, config=upright).plan(moved)
        except PlanningError:
            continue
        return f"with the phantom {where} it would fit"
    return "no other place of the phantom within 80 mm helps"
