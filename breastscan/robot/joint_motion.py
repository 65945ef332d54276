"""Straight motions in joint space with limited speed and acceleration."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

NEGLIGIBLE_WAY = 1e-12
"""Joint motion that is done in one step [rad]."""


def trapezoid(
    start: Float[np.ndarray, "6"], end: Float[np.ndarray, "6"], speed: float, acceleration: float, period: float
) -> Iterator[Float[np.ndarray, "6"]]:
    """Targets [rad] every `period` [s] from `start` to `end`, the last one exactly `end`.

    Args:
        start: Joint angles at rest [rad].
        end: Joint angles to come to rest at [rad].
        speed: Top speed of the joint with the longest way [rad/s].
        acceleration: Its acceleration [rad/s^2].
        period: Time between targets [s].
    """
    way = float(np.abs(end - start).max())
    if way < NEGLIGIBLE_WAY:
        yield end
        return
    ramp_time = min(speed / acceleration, np.sqrt(way / acceleration))
    top_speed = acceleration * ramp_time
    duration = way / top_speed + ramp_time
    for k in range(1, int(np.ceil(duration / period))):
        yield start + (end - start) * _trapezoid_way(k * period, ramp_time, top_speed, duration) / way
    yield end


def braking(
    start: Float[np.ndarray, "6"], speed: Float[np.ndarray, "6"], deceleration: float, period: float
) -> Iterator[Float[np.ndarray, "6"]]:
    """Targets [rad] every `period` [s] that bring joints at `start` moving at `speed` [rad/s] to rest together."""
    leading = float(np.abs(speed).max())
    count = int(np.ceil(leading / deceleration / period))
    for k in range(1, count + 1):
        remaining = 1 - k / count
        yield start + speed * count * period * (1 - remaining**2) / 2


def _trapezoid_way(t: float, ramp_time: float, top_speed: float, duration: float) -> float:
    """Way covered at time `t` by a motion that ramps up, cruises and ramps down [rad]."""
    acceleration = top_speed / ramp_time
    if t < ramp_time:
        return acceleration * t**2 / 2
    if t < duration - ramp_time:
        return top_speed * (t - ramp_time / 2)
    return top_speed * (duration - ramp_time) - acceleration * (duration - t) ** 2 / 2
