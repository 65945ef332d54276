"""Parts of a planned motion, at another speed, or on a plan that misses the skin: what studies and faults run on."""

import numpy as np
from jaxtyping import Float

from breastscan.execution import ScanMotion, lifted_joints
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from sim.arm.servo import PERIOD

ACCELERATION = 0.1
"""Along the path, at both ends [m/s^2]."""


def section(
    motion: ScanMotion,
    X_FP: Float[np.ndarray, "4 4"],
    *,
    start: float,
    length: float,
    speed: float,
    clearance: float | None = None,
) -> ScanMotion:
    """A part of the path from rest to rest.

    Args:
        motion: The whole.
        X_FP: Probe tip in the flange.
        start: Where on the path it begins [m].
        length: How far it goes [m].
        speed: Along the path [m/s].
        clearance: Of approach and retreat [m]; None for the whole motion's.
    """
    s = start + _trapezoid(min(length, float(motion.s[-1]) - start), speed)
    row = np.interp(s, motion.s, np.arange(len(motion.s)))
    q = np.stack([np.interp(row, np.arange(len(motion.q)), joint) for joint in motion.q.T], axis=1)
    return _motion(q, s - start, motion.clearance if clearance is None else clearance, X_FP, motion.q_home)


def misplaced(motion: ScanMotion, X_FP: Float[np.ndarray, "4 4"], depth: Float[np.ndarray, "n"]) -> ScanMotion:
    """The same path, planned `depth` [m] too deep at each row: the skin is met by so much before it is expected."""
    arm = KinematicCalibration.nominal()
    X_BP = arm.forward(motion.q) @ X_FP
    X_BP[:, :3, 3] += depth[:, None] * X_BP[:, :3, 2]
    return _motion(arm.refined(motion.q, X_BP @ se3.inverse(X_FP)), motion.s, motion.clearance, X_FP, motion.q_home)


def ramp(s: Float[np.ndarray, "n"], height: float, *, start: float, length: float) -> Float[np.ndarray, "n"]:
    """A depth [m] over the path that rises from 0 to `height` over `length` [m]."""
    return height * np.clip((s - start) / length, 0.0, 1.0)


def _motion(
    q: Float[np.ndarray, "n 6"],
    s: Float[np.ndarray, "n"],
    clearance: float,
    X_FP: Float[np.ndarray, "4 4"],
    q_home: Float[np.ndarray, "6"],
) -> ScanMotion:
    qd = np.gradient(q, PERIOD, axis=0)
    on_skin = ScanMotion(q=q, qd=qd, s=s, q_approach=q[0], clearance=clearance, q_home=q_home)
    q_approach = lifted_joints(on_skin, 0, X_FP, KinematicCalibration.nominal())
    return ScanMotion(q=q, qd=qd, s=s, q_approach=q_approach, clearance=clearance, q_home=q_home)


def _trapezoid(length: float, speed: float) -> Float[np.ndarray, "n"]:
    """Way [m] every period, from rest to rest."""
    ramp_time = min(speed / ACCELERATION, np.sqrt(length / ACCELERATION))
    top = ACCELERATION * ramp_time
    duration = length / top + ramp_time
    time = np.arange(0.0, duration, PERIOD)
    speeds = np.clip(np.minimum(time, duration - time) * ACCELERATION, 0.0, top)
    way = np.concatenate([[0.0], np.cumsum(speeds) * PERIOD])
    return way * length / way[-1]
