"""Where the tip is by now, from what was commanded: the robot's own servo (`breastscan.servo`),
along one axis.

A controller that waits for the measured effect of its own commands would count them twice. The
measured pose would do as well in principle, but it carries the arm's deflection under the very
force that is to be controlled.
"""

import math
from dataclasses import dataclass

from breastscan.servo import Servo


@dataclass(frozen=True)
class ServoModel:
    """The tip along its axis, as the servo moves it."""

    servo: Servo
    """The law that is followed."""
    position: float
    """[m]"""
    speed: float
    """[m/s]"""
    waiting: tuple[float, ...]
    """Targets within the transport time, the oldest first [m]."""

    @staticmethod
    def resting(position: float, servo: Servo, period: float) -> "ServoModel":
        """At rest at `position` [m], commanded every `period` [s]."""
        return ServoModel(servo, position, 0.0, (position,) * round(servo.transport / period))

    def after(self, target: float, lag: float, period: float) -> "ServoModel":
        """One period later.

        Args:
            target: What was sent [m].
            lag: Time by which the arm trails steady motion, as estimated by now [s]: what it is
                more or less than the servo's own counts as look-ahead time.
            period: Control period [s].
        """
        arriving, *waiting = (*self.waiting, target)
        if math.isinf(self.servo.gain):
            speed = (arriving - self.position) / period
            return ServoModel(self.servo, arriving, speed, tuple(waiting))
        position = self.position + period * self.speed
        lookahead = max(lag - period * len(waiting), 0.0)
        error = arriving - (position + lookahead * self.speed)
        speed = self.speed + period * self.servo.gain * error
        return ServoModel(self.servo, position, speed, tuple(waiting))
