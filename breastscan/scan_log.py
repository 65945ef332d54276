"""What the log of a scan says: the trajectory as a table, and how far it came."""

import math

import numpy as np

from breastscan.planning.motion import Motion
from breastscan.robot.interface import Robot
from breastscan.run.trajectory import Sample, Trajectory


def trajectory(log: list[Sample], motion: Motion, robot: Robot) -> Trajectory:
    """The whole log, the planned values beside the measured ones; off the path these are NaN.

    The poses are by the arm's kinematics as the robot reports them, and no truer than these.
    """
    row = np.array([sample.row for sample in log])
    first = np.nan_to_num(row).astype(int)
    second = np.minimum(first + 1, len(motion.q) - 1)
    q = np.stack([sample.q for sample in log])

    def planned(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        between = flat[first] + (row - first)[:, None] * (flat[second] - flat[first])
        return between.reshape(len(log), *values.shape[1:])

    return Trajectory(
        t=np.array([sample.time for sample in log]),
        phase=tuple(str(sample.phase) for sample in log),
        s=planned(motion.s),
        q=q,
        qd=np.stack([sample.qd for sample in log]),
        target=np.stack([sample.target for sample in log]),
        q_plan=planned(motion.q),
        qd_plan=planned(motion.qd),
        X_BP=robot.calibration.forward(q) @ robot.X_FP,
        X_BP_plan=planned(robot.calibration.forward(motion.q) @ robot.X_FP),
        wrench_P=np.stack([sample.wrench_P for sample in log]),
        contact=np.array([sample.contact for sample in log]),
    )


def last_row(log: list[Sample]) -> int:
    """The last row of the plan that was reached in contact; a scan that was cut off starts again
    there.
    """
    return next((int(sample.row) for sample in reversed(log) if not math.isnan(sample.row)), 0)
