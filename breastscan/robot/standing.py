"""A robot as it stands: every command is taken, and nothing moves."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from breastscan.robot.interface import Robot, RobotState


class StandingRobot:
    """Implements `breastscan.robot.interface.Robot` at one state of another robot, for what is to
    be tried before that one moves.
    """

    def __init__(self, robot: Robot) -> None:
        """Stand where `robot` stands; it is not commanded."""
        self.period = robot.period
        """Control period [s]."""
        self.X_FP = robot.X_FP
        """Pose of the probe tip in the flange."""
        self.calibration = robot.calibration
        """The arm's kinematics."""
        self.servo = robot.servo
        """How the other robot follows its targets."""
        self._state = robot.state()

    def state(self) -> RobotState:
        """The state of the beginning, as many periods later as there were commands."""
        return self._state

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Let a period pass, with a new sample of the sensor."""
        time, sample = self._state.time + self.period, self._state.sample + 1
        self._state = replace(self._state, time=time, sample=sample)

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Nothing."""

    def tare(self) -> None:
        """Nothing."""

    def stop(self) -> None:
        """Nothing."""
