"""What the log of a scan says: the trajectory as a table, how far it came, and where it goes on."""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.planning.motion import Motion
from breastscan.robot.interface import Robot
from breastscan.run.trajectory import LOOP, OVERLAP, RESUME, Sample, Trajectory

OVERLAP_LENGTH = 0.01
"""How far before the last place in contact a scan that was cut off makes contact again [m]: the
feed is at its full speed after 6 mm, the force has settled before."""


def trajectory(log: list[Sample], motion: Motion, robot: Robot) -> Trajectory:
    """The whole log, the planned values beside the measured ones; off the path these are NaN.

    The poses are by the arm's kinematics as the robot reports them, and no truer than these. A scan
    that was resumed is one table: what it did twice is called so, and the clock of a controller
    that was switched off in between goes on.
    """
    row = np.array([sample.row for sample in log])
    phase = np.array([str(sample.phase) for sample in log], object)
    t = np.array([sample.time for sample in log])
    for first in np.flatnonzero(phase == RESUME):
        reached = max(row[:first][phase[:first] == LOOP], default=-1.0)
        later = np.arange(len(log)) > first
        phase[later & (phase == LOOP) & (row <= reached)] = OVERLAP
        if first and t[first] <= t[first - 1]:
            t[first:] += t[first - 1] + robot.period - t[first]
    first = np.nan_to_num(row).astype(int)
    second = np.minimum(first + 1, len(motion.q) - 1)
    q = np.stack([sample.q for sample in log])

    def planned(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        between = flat[first] + (row - first)[:, None] * (flat[second] - flat[first])
        return between.reshape(len(log), *values.shape[1:])

    X_BP_plan = planned(robot.calibration.forward(motion.q) @ robot.X_FP)
    # along the axis the force governs
    shift_B = np.stack([sample.shift_B for sample in log])
    X_BP_plan[:, :3, 3] += se3.across(shift_B, X_BP_plan[:, :3, 2])
    return Trajectory(
        t=t,
        phase=tuple(phase),
        s=planned(motion.s),
        q=q,
        qd=np.stack([sample.qd for sample in log]),
        target=np.stack([sample.target for sample in log]),
        q_plan=planned(motion.q),
        qd_plan=planned(motion.qd),
        X_BP=robot.calibration.forward(q) @ robot.X_FP,
        X_BP_plan=X_BP_plan,
        wrench_P=np.stack([sample.wrench_P for sample in log]),
        contact=np.array([sample.contact for sample in log]),
    )


def last_row(log: list[Sample]) -> int:
    """The last row of the plan that was reached in contact; 0 where none was."""
    return max((int(sample.row) for sample in log if sample.phase == LOOP), default=0)


def resumption_row(log: list[Sample], s: Float[np.ndarray, "n"]) -> int:
    """Row at which a scan that was cut off makes contact again, so that no gap remains; 0 where it
    had made none.

    Args:
        log: Until it was cut off.
        s: Length along its plan at each row [m].
    """
    return max(int(np.searchsorted(s, s[last_row(log)] - OVERLAP_LENGTH, side="right")) - 1, 0)
