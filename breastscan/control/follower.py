"""A number that follows a target with a bounded acceleration.

Whatever corrects the plan passes through here, so that a target that jumps, or ends, asks no joint
for more than the supervisor allows.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Follower:
    """Where the follower is, and how fast it moves."""

    position: float = 0.0
    rate: float = 0.0
    """Per second."""

    def after(
        self,
        target: float,
        speed: float,
        corner_hz: float,
        period: float,
        acceleration: float = math.inf,
    ) -> "Follower":
        """One period later: a low-pass of second order, critically damped, that knows the target's
        speed and so does not trail one that moves steadily.

        Args:
            target: Where to be.
            speed: How fast that moves, per second.
            corner_hz: Of the low-pass [Hz].
            period: [s].
            acceleration: Bound, per second squared.
        """
        corner = 2.0 * math.pi * corner_hz
        pull = corner * corner * (target - self.position) + 2.0 * corner * (speed - self.rate)
        rate = self.rate + min(max(pull, -acceleration), acceleration) * period
        return Follower(self.position + rate * period, rate)


def towards(rate: float, wanted: float, acceleration: float, period: float) -> float:
    """A speed one period [s] on, on its way to the wanted one within an acceleration."""
    step = acceleration * period
    return min(max(wanted, rate - step), rate + step)


def stopping_speed(distance: float, acceleration: float) -> float:
    """Largest speed from which one still stops within a distance; 0 beyond it."""
    return math.sqrt(2.0 * acceleration * max(distance, 0.0))
