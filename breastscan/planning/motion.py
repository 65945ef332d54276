"""From a path on the skin to a timed joint trajectory: feedrate and joint path together, slowed until both agree.

The feedrate knows the curve's limits and the joint path those of the arm. Where the arm could not keep up, the whole
motion takes longer: its shape in time stays, so that nothing is added to the fluctuation of its speed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import feedrate, joint_limits, joint_path, route
from breastscan.planning.feedrate import Feed, FeedrateLimits
from breastscan.planning.joint_limits import Clearances, JointPathConfig, LimitUse
from breastscan.planning.joint_path import JointPath
from breastscan.planning.pattern import Path

MOST_PASSES = 4
"""How often the motion is slowed at most: the second pass corrects what the rounding to whole periods changed."""
SLACK = 1.001
"""How much slower than needed, so that rounding breaks no limit."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A path with its timing and its joint angles, one row a control period."""

    feed: Feed
    joints: JointPath
    slowed: float
    """How many times longer it takes than the feedrate alone would; 1 where the joints keep up."""
    uses: list[LimitUse]
    """How near the joints come to each limit, and where."""


def plan(
    path: Path,
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    limits: FeedrateLimits,
    config: JointPathConfig,
    *,
    clearances: Clearances | None = None,
    calibration: KinematicCalibration | None = None,
) -> Motion:
    """The motion along a path inside every limit of the feedrate and of the arm.

    Args:
        path: Points and normals on the skin, in B.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        limits: What the motion along the curve keeps to.
        config: What the joints keep to.
        clearances: Measures the arm's distance from itself and its surroundings; None leaves that out.
        calibration: The arm's own kinematics; None for the nominal arm's.

    Raises:
        PlanningError: Some point cannot be reached, or no path joins the reachable poses inside every limit.
    """
    feed = feedrate.interpolate(path.curve, limits, period)
    chosen = route.choose(feed.positions, path.normals(feed.u), X_FP, period, config, clearances)
    slowed = 1.0
    for _ in range(MOST_PASSES):
        joints = joint_path.follow(chosen, feed.positions, path.normals(feed.u), X_FP, period, config, calibration)
        uses = joint_limits.limit_uses(joints.q, period, config)
        longer = joint_limits.dilation(uses)
        if longer == 1.0:
            joint_limits.check_trajectory(joints.q, period, config, clearances)
            return Motion(feed=feed, joints=joints, slowed=slowed, uses=uses)
        slowed *= longer * SLACK
        feed = feedrate.interpolate(path.curve, limits.slowed(slowed), period)
    raise PlanningError(
        f"the joints break a limit of speed, acceleration or jerk although the path takes {slowed:.1f} times as long: "
        "free the probe's spin, or move the phantom away from the arm's singularities",
        slowed,
    )
