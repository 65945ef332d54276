"""A run folder played back as a robot: what a controller did once, held against what it does
now.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError, RobotError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.interface import RobotState
from breastscan.robot.ur.ur5e import SERVO
from breastscan.run.trajectory import LOG_FILE, Trajectory
from breastscan.servo import Servo

READ = ("t", "q", "qd", "target", "X_BP", "wrench_P")
"""What is read of the log."""
TOOL_SPREAD = 1e-5
"""Most by which the tool's pose may differ from row to row [m, and in rotation's entries -]: the
log's poses follow from its joint angles, so more means another kinematic calibration."""
TOLERANCE = 1e-3
"""Most by which a joint's target may differ from the recorded one [rad], .8 mm at the tip. A
recording does not react, so a law that integrates what it feels drifts on it: over 60 mm of
contact by 2e-4 rad from a fitted lag that is 8e-6 s off, by 3e-8 rad from the right one."""
CLOCK_DIGITS = 6
"""Decimals of the period [s]: a median of differences is off by rounding, and who counts periods by
it is one off."""


class RecordedRobot:
    """Implements `breastscan.robot.interface.Robot` on the trajectory that a scan left, for the
    regression of controllers.

    Each `servo_joint` advances the recording by one of its rows, which `state` then shows. The
    recording cannot react to a command that was not given at the time: a target further from the
    recorded one than the tolerance is refused, with the place where the two runs part. Rows follow
    each other as commands did; where the log has a gap in time, so have the states.

    Free motions are not in the log. `move_joint` is taken as done and changes nothing: if it ends
    elsewhere than the recorded one did, the next `servo_joint` tells. `tare` keeps the recorded
    zero, and `stop` rests at the present row. The first row is the state before the first command.
    The log does not hold the sensor's count, so every row counts as one sample.
    """

    def __init__(
        self,
        recording: Trajectory,
        *,
        calibration: KinematicCalibration | None = None,
        servo: Servo | None = None,
        tolerance: float = TOLERANCE,
    ) -> None:
        """Stand at the first row.

        Args:
            recording: What was done.
            calibration: The arm's kinematics in that run; None for the nominal ones.
            servo: The servo that the robot of that run said it had. A log does not hold it: None
                fits the lag to the recording and assumes a UR's gain and transport for the rest.
            tolerance: Most by which a joint's target may differ from the recorded one [rad].

        Raises:
            ConfigError: A number is not finite, there are too few rows, or the kinematics are not
                those of the recording.
        """
        _require_whole(recording)
        self._log = recording
        self.calibration = KinematicCalibration.nominal() if calibration is None else calibration
        """The kinematics that the recording was opened with."""
        self._tolerance = tolerance
        self.period = round(float(np.median(np.diff(self._log.t))), CLOCK_DIGITS)
        """Control period of the recording [s]."""
        self.X_FP = _tool(self.calibration.forward(self._log.q), recording.X_BP)
        """Pose of the probe tip in the flange, as the recorded poses imply it."""
        self.servo = (
            _assumed_servo(_lag(self._log.q, self._log.target, self.period))
            if servo is None
            else servo
        )
        """How the recorded joints followed their targets: as given, or assumed, with a lag that is
        fitted over the whole recording."""
        self._row = 0

    @staticmethod
    def load(folder: Path, **options: Any) -> "RecordedRobot":
        """Play a run folder back; options as of the class.

        Raises:
            ConfigError: The folder holds no trajectory, or one that cannot be played.
        """
        return RecordedRobot(Trajectory.load(folder / LOG_FILE), **options)

    @property
    def rows_left(self) -> int:
        """Commands for which the recording still has rows."""
        return len(self._log.t) - 1 - self._row

    def state(self) -> RobotState:
        """The present row; the first one is that of before any command."""
        row = self._row
        return RobotState(
            time=float(self._log.t[row]),
            q=self._log.q[row].copy(),
            qd=self._log.qd[row].copy(),
            wrench_P=self._log.wrench_P[row].copy(),
            sample=row,
        )

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Go on by one row.

        Raises:
            RobotError: The recording is at its end, or had another target here.
        """
        if not self.rows_left:
            raise RobotError(
                f"the recording ends after {self._row} commands: the run that is replayed goes on "
                "for longer",
                self._row,
            )
        row = self._row + 1
        off = np.abs(q - self._log.target[row])
        if not off.max() <= self._tolerance:
            joint = int(np.argmax(off))
            raise RobotError(
                f"the runs part at command {self._row}, {self._log.t[row]:.3f} s: joint "
                f"{joint + 1} goes to {q[joint]:.5f} rad, the recorded one to "
                f"{self._log.target[row, joint]:.5f} rad, more than {self._tolerance:g} rad apart: "
                "look at both runs before this time",
                q,
            )
        self._row = row

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Take a free motion as done.

        Raises:
            RobotError: The target is not finite.
        """
        if not np.isfinite(q).all():
            raise RobotError(f"joint targets must be finite, got {q}", q)

    def tare(self) -> None:
        """Keep the recorded zero."""

    def stop(self) -> None:
        """Rest at the present row."""


def _require_whole(log: Trajectory) -> None:
    """Refuse a recording that cannot be played."""
    if len(log.t) < 2:
        raise ConfigError(
            f"the recording holds {len(log.t)} rows, expected two or more", len(log.t)
        )
    for name in READ:
        if not np.isfinite(getattr(log, name)).all():
            raise ConfigError(f"{name} of the recording holds a value that is not finite", name)


def _tool(
    X_BF: Float[np.ndarray, "n 4 4"], X_BP: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "4 4"]:
    """The pose of the tip in the flange that joins the two; the same in every row."""
    X_FP = se3.inverse(X_BF) @ X_BP
    spread = float(np.ptp(X_FP, axis=0).max())
    if spread > TOOL_SPREAD:
        raise ConfigError(
            "the recorded poses do not follow from the recorded angles (the tool moves by "
            f"{spread:.1e} in the flange): give the kinematic calibration with which the run was "
            "made",
            spread,
        )
    return X_FP[0]


def _assumed_servo(lag: float) -> Servo:
    """A UR's servoj that trails by `lag` [s]; where that is less than its transport, a delay."""
    if lag <= SERVO.transport:
        return Servo.pure_delay(max(lag, 0.0))
    return replace(SERVO, lookahead_time=lag - SERVO.transport)


def _lag(q: Float[np.ndarray, "n 6"], target: Float[np.ndarray, "n 6"], period: float) -> float:
    """The time that, with the targets' speed, explains best how far the joints trail [s]; 0
    where nothing moves.
    """
    speed = np.gradient(target, period, axis=0)
    moved = float(np.sum(speed**2))
    return float(np.sum(speed * (target - q))) / moved if moved > 0 else 0.0
