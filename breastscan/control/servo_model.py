"""Where the tip is by now, from what was commanded: the servo's model along one axis.

A controller that waits for the measured effect of its own commands would count them twice. The
measured pose would do as well in principle, but it carries the arm's deflection under the very
force that is to be controlled.
"""

from dataclasses import dataclass

TRANSPORT = 0.004
"""Part of the servo's lag in which nothing happens yet [s]: two periods of RTDE [UR-lag]."""
GAIN = 2000.0
"""servoj's gain, its largest: acceleration per error against the target [1/s^2] [UR-script]."""
NO_LAG = 0.01
"""Lag below which a servo counts as being at its target [s]: servoj's least lookahead is .03 s."""


@dataclass(frozen=True)
class ServoModel:
    """The tip along its axis, as servoj moves it: q'' = gain (target - (q + lookahead q'))."""

    position: float
    """[m]"""
    speed: float
    """[m/s]"""
    waiting: tuple[float, ...]
    """Targets that are under way, the oldest first [m]."""

    @staticmethod
    def resting(position: float, period: float) -> "ServoModel":
        """At rest at `position` [m]."""
        return ServoModel(position, 0.0, (position,) * round(TRANSPORT / period))

    def after(self, target: float, lag: float, period: float) -> "ServoModel":
        """One period [s] later, a target [m] having been sent to a servo that trails steady
        motion by `lag` [s].
        """
        if lag < NO_LAG:
            return ServoModel(target, (target - self.position) / period, self.waiting)
        arriving, *waiting = (*self.waiting, target)
        position = self.position + period * self.speed
        lookahead = lag - period * len(waiting)
        error = arriving - (position + lookahead * self.speed)
        return ServoModel(position, self.speed + period * GAIN * error, tuple(waiting))
