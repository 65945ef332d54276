"""Straight motions with limited speed and acceleration."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

NEGLIGIBLE_DISTANCE = 1e-12
"""Joint motion that is done in one step [rad]."""


class Trapezoid:
    """Trapezoidal speed profile from rest to rest, as fast as speed and acceleration allow."""

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        """Of a positive `length` [m or rad], at most `speed` and `acceleration` [the same per s
        and s^2].
        """
        self._length, self._acceleration = length, acceleration
        self._ramp_time = min(speed / acceleration, np.sqrt(length / acceleration))
        self._top_speed = acceleration * self._ramp_time
        self.duration = float(length / self._top_speed + self._ramp_time)
        """[s]"""

    def distance(self, t: float) -> float:
        """Distance covered by the time `t` [s]."""
        if t < self._ramp_time:
            return self._acceleration * t**2 / 2
        if t < self.duration - self._ramp_time:
            return self._top_speed * (t - self._ramp_time / 2)
        return self._length - self._acceleration * max(self.duration - t, 0.0) ** 2 / 2


def trapezoid(
    start: Float[np.ndarray, "6"],
    end: Float[np.ndarray, "6"],
    speed: float,
    acceleration: float,
    period: float,
) -> Iterator[Float[np.ndarray, "6"]]:
    """Targets [rad] every `period` [s] from `start` to `end`, the last one exactly `end`.

    Args:
        start: Joint angles at rest [rad].
        end: Joint angles to come to rest at [rad].
        speed: Top speed of the joint with the longest motion [rad/s].
        acceleration: Its acceleration [rad/s^2].
        period: Time between targets [s].
    """
    distance = float(np.abs(end - start).max())
    if distance < NEGLIGIBLE_DISTANCE:
        yield end
        return
    profile = Trapezoid(distance, speed, acceleration)
    for k in range(1, int(np.ceil(profile.duration / period))):
        yield start + (end - start) * profile.distance(k * period) / distance
    yield end


def braking(
    start: Float[np.ndarray, "6"], speed: Float[np.ndarray, "6"], deceleration: float, period: float
) -> Iterator[Float[np.ndarray, "6"]]:
    """Targets [rad] every `period` [s] that bring joints at `start` moving at `speed` [rad/s] to
    rest together.
    """
    leading = float(np.abs(speed).max())
    count = int(np.ceil(leading / deceleration / period))
    for k in range(1, count + 1):
        remaining = 1 - k / count
        yield start + speed * count * period * (1 - remaining**2) / 2
