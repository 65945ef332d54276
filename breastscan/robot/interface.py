"""What a robot must offer, be it simulated, recorded or real.

The twin and the hardware implement this protocol; nothing in `breastscan` knows which of them it
drives.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.servo import Servo


@dataclass(frozen=True, kw_only=True)
class RobotState:
    """One sample of the robot, all of it measured at the same instant."""

    time: float
    """Robot's own clock [s]."""
    q: Float[np.ndarray, "6"]
    """Joint angles as the encoders have them [rad]."""
    qd: Float[np.ndarray, "6"]
    """Joint speeds [rad/s]."""
    wrench_P: Float[np.ndarray, "6"]
    """Wrench that the tissue exerts on the probe, force first, at the tip P in basis P [N, N m]:
    since the last `tare`, with the tool's own weight taken out. A pressing probe reads a negative
    force along z."""
    sample: int
    """Counts the wrist sensor's samples: a count that stands still while `time` passes is a frozen
    sensor, which a repeated value alone would not show."""


@runtime_checkable
class Robot(Protocol):
    """A UR5e with a probe and a wrist sensor, commanded in joint space."""

    @property
    def period(self) -> float:
        """Control period [s]."""
        ...

    @property
    def X_FP(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the probe tip in the flange, as the tool was set up."""
        ...

    @property
    def calibration(self) -> KinematicCalibration:
        """The arm's kinematics as read from its controller, which plan and control go by; the
        nominal ones where nothing was read. The true ones are known to nobody.
        """
        ...

    @property
    def servo(self) -> Servo:
        """How the arm follows the targets of `servo_joint`: `state` after one shows, in steady
        motion, about the target of `servo.lag` ago. Nominal; whoever wants the arm on a planned
        motion leads its targets by the lag, and whoever predicts the arm goes by all of it.
        """
        ...

    def state(self) -> RobotState:
        """The latest sample. Does not wait.

        Raises:
            RobotError: The link is down or the sample is stale.
        """
        ...

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Track joint target `q` [rad] for one period, and return when the next period starts.

        Raises:
            RobotError: The command was refused or the robot has stopped.
        """
        ...

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Move to `q` [rad] on a straight line in joint space and wait until there.

        Args:
            q: Target angles [rad].
            speed: Top speed of the leading joint [rad/s].
            acceleration: Its acceleration [rad/s^2].

        Raises:
            RobotError: The robot refused or stopped.
        """
        ...

    def tare(self) -> None:
        """Take the present wrench as zero."""
        ...

    def stop(self) -> None:
        """Come to rest as fast as is gentle, and stay there."""
        ...
