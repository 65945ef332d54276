"""Parts of a planned motion, at another speed, or on a plan that misses the skin: what studies
and faults run on.
"""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion
from breastscan.robot.joint_motion import Trapezoid
from breastscan.robot.ur.ur5e import PERIOD

ACCELERATION = 0.1
"""Along the path, at both ends [m/s^2]."""


def section(
    motion: Motion,
    X_FP: Float[np.ndarray, "4 4"],
    *,
    start: float,
    length: float,
    speed: float,
    clearance: float | None = None,
) -> Motion:
    """A part of the path from rest to rest.

    Args:
        motion: The whole.
        X_FP: Probe tip in the flange.
        start: Where on the path it begins [m].
        length: How far it goes [m].
        speed: Along the path [m/s].
        clearance: Of approach and retreat [m]; None for the whole motion's.
    """
    profile = Trapezoid(min(length, float(motion.s[-1]) - start), speed, ACCELERATION)
    s = start + np.array(
        [profile.distance(PERIOD * k) for k in range(math.ceil(profile.duration / PERIOD) + 1)]
    )
    row = np.interp(s, motion.s, np.arange(len(motion.s)))
    q = np.stack([np.interp(row, np.arange(len(motion.q)), joint) for joint in motion.q.T], axis=1)
    return _motion(q, s - start, motion.clearance if clearance is None else clearance, X_FP)


def misplaced(
    motion: Motion, X_FP: Float[np.ndarray, "4 4"], depth: Float[np.ndarray, "n"]
) -> Motion:
    """The same path, planned `depth` [m] too deep at each row: the skin is met by so much before
    it is expected.
    """
    arm = KinematicCalibration.nominal()
    X_BP = arm.forward(motion.q) @ X_FP
    X_BP[:, :3, 3] += depth[:, None] * X_BP[:, :3, 2]
    return _motion(
        arm.refined(motion.q, X_BP @ se3.inverse(X_FP)), motion.s, motion.clearance, X_FP
    )


def ramp(
    s: Float[np.ndarray, "n"], height: float, *, start: float, length: float
) -> Float[np.ndarray, "n"]:
    """A depth [m] over the path that rises from 0 to `height` over `length` [m]."""
    return height * np.clip((s - start) / length, 0.0, 1.0)


def _motion(
    q: Float[np.ndarray, "n 6"],
    s: Float[np.ndarray, "n"],
    clearance: float,
    X_FP: Float[np.ndarray, "4 4"],
) -> Motion:
    on_skin = Motion(
        q=q, qd=np.gradient(q, PERIOD, axis=0), s=s, q_approach=q[0], clearance=clearance
    )
    return replace(on_skin, q_approach=on_skin.lifted(0, X_FP, KinematicCalibration.nominal()))
