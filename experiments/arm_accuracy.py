"""How far from its plan is the tip of an arm that deviates from its drawing, with and without
its calibration read?
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from sim.arm.deviations import ArmConfig, calibration, true_arm

ARMS = 30


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Of many arms along one path."""

    position: Float[np.ndarray, "arms n"]
    """Distance of the true tip from the planned one [m]."""
    tilt: Float[np.ndarray, "arms n"]
    """Angle between the true probe axis and the planned one [rad]."""


def along(
    q: Float[np.ndarray, "n 6"],
    X_FP: Float[np.ndarray, "4 4"],
    kind: Literal["uncalibrated", "calibrated"],
    seed: int,
) -> Accuracy:
    """Where `ARMS` arms of one kind bring the tip, each commanded by the calibration that it
    reports.

    Args:
        q: A path of the nominal arm [rad]; where it brings the tip is the plan.
        X_FP: Probe tip in the flange.
        kind: Whether the calibrations are read.
        seed: Of the arms.
    """
    X_BF = kinematics.forward(q)
    position, tilt = [], []
    for number in range(ARMS):
        config = ArmConfig(kinematics=kind, seed=seed * ARMS + number)
        reached = _reached(q, X_BF, calibration(config), true_arm(config)) @ X_FP
        planned = X_BF @ X_FP
        position.append(np.linalg.norm(reached[:, :3, 3] - planned[:, :3, 3], axis=1))
        tilt.append(se3.angle_between(reached[:, :3, 2], planned[:, :3, 2]))
    return Accuracy(position=np.array(position), tilt=np.array(tilt))


def _reached(
    q: np.ndarray, X_BF: np.ndarray, reported: KinematicCalibration, true: KinematicCalibration
) -> Float[np.ndarray, "n 4 4"]:
    """True flange poses of an arm whose joint angles were computed with the calibration that it
    reports.
    """
    return true.forward(reported.refined(q, X_BF))
