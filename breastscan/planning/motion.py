"""From a path on the skin to a timed joint trajectory: feedrate and joint path together, slowed
until both agree.

The feedrate knows the curve's limits and the joint path those of the arm. Where the arm could not
keep up, the whole motion takes longer: its shape in time stays, so that nothing is added to the
fluctuation of its speed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import feedrate, joint_limits, joint_path, probe_poses, redundancy
from breastscan.planning.clearance import Clearance
from breastscan.planning.feedrate import Feed, FeedrateLimits
from breastscan.planning.joint_limits import Corrections, JointPathConfig
from breastscan.planning.pattern import Path

REACHED = 0.99
"""Share of the top speed that counts as reached [-]."""
WIDER = 4.0
"""Factor on one limit that shows whether it is the one that binds [-]."""
MM_PER_M = 1e3
MAX_PASSES = 4
"""How often the motion is slowed at most: the second pass corrects what the rounding to whole
periods changed."""
SLACK = 1.001
"""How much slower than needed, so that rounding breaks no limit."""
DRAG_EXPONENT = 1.5
"""Power of the indentation that the touched skin's sideways motion grows with [-]: it is
proportional to the force, and a rounded body's contact force to this power of the depth (Hertz)."""
LIFT_STEP = 25
"""Rows from one check of the lifted pose to the next: 1.25 mm at 25 mm/s."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What the arm is to do: strokes on the skin, one row a control period, and how to come to the
    first.
    """

    q: Float[np.ndarray, "n 6"]
    """Joint angles with the probe tip on the planned skin [rad]."""
    qd: Float[np.ndarray, "n 6"]
    """Their speeds [rad/s]."""
    s: Float[np.ndarray, "n"]
    """Length along the path [m]; a stroke goes on counting where the one before ended."""
    q_approach: Float[np.ndarray, "6"]
    """Joint angles with the probe clear of the skin in front of the path's first point [rad]."""
    clearance: float
    """How far in front of it, along the probe axis [m]; the retreat ends as far from the last
    point."""
    starts: tuple[int, ...] = (0,)
    """First row of each stroke. From the last row of one to the first of the next the arm goes
    clear of the skin."""
    ways: tuple[tuple[Float[np.ndarray, "6"], ...], ...] = ()
    """To each stroke from the one before, to the first from home, and from the last home: over
    which joint angles the arm goes [rad]. Without any, straight."""
    slowed: float = 1.0
    """How many times longer it takes than the feedrate alone would; 1 where the joints keep up."""
    largest_tilt: float = 0.0
    """How far the probe leans from the normal at most, where no roll would do [rad]."""
    chest_normal_B: Float[np.ndarray, "3"] | None = None
    """Outward unit normal of the chest, along which breathing moves it; None where it is not known,
    and the probe does not breathe along."""
    drag_B: Float[np.ndarray, "n 3"] | None = None
    """What `drag_at` multiplies by the indentation's power, across the probe axis [m^-1/2]; None
    where no tissue was modelled."""

    @property
    def lasts(self) -> tuple[int, ...]:
        """Last row of each stroke."""
        return (*(start - 1 for start in self.starts[1:]), len(self.q) - 1)

    def stroke_of(self, row: int) -> int:
        """Number of the stroke that a row belongs to, from 0."""
        return int(np.searchsorted(self.starts, row, side="right")) - 1

    def turned(self, near: Float[np.ndarray, "6"], limit: Float[np.ndarray, "6"]) -> "Motion":
        """The same with its joints turned by whole rotations.

        Args:
            near: To where the first row is to be nearest [rad].
            limit: Largest angle of each joint [rad].
        """
        rotations = _rotations(self.q, near, limit)
        return replace(self, q=self.q + rotations, q_approach=self.q_approach + rotations)

    def at(self, row: float) -> Float[np.ndarray, "6"]:
        """Joint angles [rad] at a row, with a fraction."""
        return _between_rows(self.q, row)

    def drag_at(self, row: float, indentation: float) -> Float[np.ndarray, "3"]:
        """How far pressing moves the skin under the tip across the probe axis, in B [m].

        The skin's point that was planned comes to be touched where the tip is displaced by as much.

        Args:
            row: Of the plan, with a fraction.
            indentation: Depth of the tip below the undeformed skin [m]; 0 or less outside of it.
        """
        if self.drag_B is None or indentation <= 0:
            return np.zeros(3)
        return indentation**DRAG_EXPONENT * _between_rows(self.drag_B, row)

    def lifted(
        self, row: int, X_FP: Float[np.ndarray, "4 4"], arm: KinematicCalibration
    ) -> Float[np.ndarray, "6"]:
        """Joint angles [rad] with the tip clear of the skin above a row; NaN where out of reach."""
        X_lifted = probe_poses.retreated(arm.forward(self.q[row]) @ X_FP, self.clearance)
        return arm.refined(self.q[row], X_lifted @ se3.inverse(X_FP))

    def require_lift(self, X_FP: Float[np.ndarray, "4 4"], arm: KinematicCalibration) -> None:
        """Refuse a path that the arm cannot leave along the probe's axis, wherever it is on it.

        Raises:
            PlanningError: It cannot.
        """
        for row in (*range(0, len(self.q), LIFT_STEP), *self.lasts):
            if not np.isfinite(self.lifted(row, X_FP, arm)).all():
                raise PlanningError(
                    f"{self.s[row] * 1e3:.0f} mm along the path the probe cannot be lifted by "
                    f"{self.clearance * 1e3:.0f} mm: move the phantom closer to the robot's base",
                    row,
                )


def joined(strokes: Sequence[Motion]) -> Motion:
    """Strokes of one path each, one after the other."""
    s = [strokes[0].s]
    for stroke in strokes[1:]:
        s.append(s[-1][-1] + stroke.s)
    counts = [len(stroke.q) for stroke in strokes]
    return replace(
        strokes[0],
        q=np.concatenate([stroke.q for stroke in strokes]),
        qd=np.concatenate([stroke.qd for stroke in strokes]),
        s=np.concatenate(s),
        drag_B=_concatenated([stroke.drag_B for stroke in strokes]),
        starts=(0, *np.cumsum(counts[:-1]).tolist()),
        slowed=max(stroke.slowed for stroke in strokes),
        largest_tilt=max(stroke.largest_tilt for stroke in strokes),
    )


def _concatenated(rows: Sequence[np.ndarray | None]) -> np.ndarray | None:
    known = [values for values in rows if values is not None]
    return np.concatenate(known) if known else None


def _rotations(q: np.ndarray, before: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Whole rotations of each joint [rad] that bring the first row of `q` nearest to other angles,
    with every row inside the limits.
    """
    turns = 2.0 * np.pi * np.arange(-2, 3)[:, None]
    inside = (q.min(axis=0) + turns >= -limit) & (q.max(axis=0) + turns <= limit)
    away = np.where(inside, np.abs(q[0] + turns - before), np.inf)
    return turns[np.argmin(away, axis=0), 0]


def _between_rows(values: Float[np.ndarray, "n k"], row: float) -> Float[np.ndarray, "k"]:
    """Linear between the rows; the last row's beyond it."""
    first = int(row)
    second = min(first + 1, len(values) - 1)
    return values[first] + (row - first) * (values[second] - values[first])


def plan_motion(
    path: Path,
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    limits: FeedrateLimits,
    config: JointPathConfig,
    *,
    clearance: Clearance | None = None,
    corrections: Corrections | None = None,
    calibration: KinematicCalibration | None = None,
    q_before: Float[np.ndarray, "6"] | None = None,
) -> tuple[Motion, Feed]:
    """The motion along a path inside every limit of the feedrate and of the arm, and the feed it
    was made from.

    Args:
        path: Points and normals on the skin, in B.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        limits: What the motion along the curve keeps to.
        config: What the joints keep to.
        clearance: Measures distances from the arm itself, its cell and the body; None leaves them
            out.
        corrections: What the controller may add to it, and the supervisor's limits; None leaves
            that out.
        calibration: The arm's own kinematics; None for the nominal arm's.
        q_before: Joint angles that the arm comes from [rad]; None for wherever.

    Raises:
        PlanningError: Some point cannot be reached, or no path joins the reachable poses inside
            every limit.
    """
    feed = feedrate.interpolate(path.curve, limits, period)
    chosen = redundancy.resolve(
        feed.positions, path.normals(feed.u), X_FP, period, config, clearance, corrections,
        along=path.array_along, q_before=q_before,
    )  # fmt: skip
    slowed = 1.0
    for _ in range(MAX_PASSES):
        q, q_approach = joint_path.follow(
            chosen, feed.positions, path.normals(feed.u), X_FP, config.clearance, calibration
        )
        longer = joint_limits.time_scaling(joint_limits.limit_uses(q, period, config))
        if corrections is not None:
            gains = joint_limits.correction_gains(q, X_FP)
            longer = max(longer, corrections.time_scaling(q, period, gains))
        if longer == 1.0:
            joint_limits.check_trajectory(q, period, config)
            qd = np.gradient(q, period, axis=0)
            planned = Motion(
                q=q,
                qd=qd,
                s=feed.s,
                q_approach=q_approach,
                clearance=config.clearance,
                slowed=slowed,
                largest_tilt=chosen.largest_tilt,
            )
            return planned, feed
        slowed *= longer * SLACK
        feed = feedrate.interpolate(path.curve, limits.slowed(slowed), period)
    raise PlanningError(
        "the joints break a limit of speed, acceleration or jerk although the path takes "
        f"{slowed:.1f} times as long: free the probe's roll, or move the phantom away from the "
        "arm's singularities",
        slowed,
    )


def hidden_speed(
    path: Path, planned: Motion, feed: Feed, limits: FeedrateLimits, period: float
) -> str | None:
    """What to tell of a top speed that other limits hide; None where some point of the path has it.

    Args:
        path: What was planned for.
        planned: The motion.
        feed: The feed it was made from.
        limits: What the feed was asked to keep to.
        period: Control period [s].
    """
    reached = float(feed.speeds.max())
    if reached > REACHED * limits.speed:
        return None
    held_by = [
        name
        for name in ("normal_acceleration", "acceleration", "jerk", "chord_error")
        if _top_speed(path, replace(limits, **{name: WIDER * getattr(limits, name)}), period)
        > reached / REACHED
    ]
    if planned.slowed > 1.0:  # of the feedrate's own, none was the last to bind
        held_by = ["the joints' limits"]
    return (
        f"planning.feedrate.speed, {limits.speed * MM_PER_M:g} mm/s, is reached nowhere: "
        f"{' and '.join(held_by)} keep the probe at {reached * MM_PER_M:.1f} mm/s or less"
    )


def _top_speed(path: Path, limits: FeedrateLimits, period: float) -> float:
    return float(feedrate.interpolate(path.curve, limits, period).speeds.max())
