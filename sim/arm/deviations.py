"""How one arm differs from its drawing, and how much of that its calibration file tells."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from breastscan.geometry.kinematic_calibration import KinematicCalibration

LENGTH_SIGMA, ANGLE_SIGMA = 0.5e-3, np.deg2rad(0.05)
"""Of each DH length [m] and angle [rad] against the nominal one: an arm whose calibration was not
read."""
LENGTH_RESIDUAL, ANGLE_RESIDUAL = 0.05e-3, np.deg2rad(0.005)
"""What the calibration itself leaves of them, one sigma [m], [rad]."""


@dataclass(frozen=True, kw_only=True)
class ArmConfig:
    """Which arm stands there, and whether its calibration is read."""

    kinematics: Literal["nominal", "uncalibrated", "calibrated"] = "nominal"
    """nominal: the arm is as drawn. uncalibrated: every DH parameter deviates (.5 mm, .05 deg), and
    nobody knows. calibrated: it deviates as much, and the robot tells all of it but .05 mm and .005
    deg."""
    seed: int | None = None
    """Draws the deviations: one number, one arm; None follows the seed of the whole."""


def true_arm(config: ArmConfig) -> KinematicCalibration:
    """The arm that stands there."""
    return _arm(_deviations(config))


def calibration(config: ArmConfig) -> KinematicCalibration:
    """What the robot tells of its arm: its calibration, or the nominal numbers."""
    if config.kinematics != "calibrated":
        return KinematicCalibration.nominal()
    residual = np.random.default_rng([config.seed or 0, 1]).standard_normal((4, 6))
    return _arm(_deviations(config) + _scaled(residual, LENGTH_RESIDUAL, ANGLE_RESIDUAL))


def _deviations(config: ArmConfig) -> np.ndarray:
    """Corrections of theta [rad], d [m], a [m] and alpha [rad], one row each."""
    if config.kinematics == "nominal":
        return np.zeros((4, 6))
    drawn = np.random.default_rng(config.seed or 0).standard_normal((4, 6))
    return _scaled(drawn, LENGTH_SIGMA, ANGLE_SIGMA)


def _scaled(drawn: np.ndarray, length: float, angle: float) -> np.ndarray:
    return np.array([angle, length, length, angle])[:, None] * drawn


def _arm(corrections: np.ndarray) -> KinematicCalibration:
    theta, d, a, alpha = corrections
    return KinematicCalibration.from_dh_corrections(theta=theta, d=d, a=a, alpha=alpha)
