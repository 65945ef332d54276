"""Force along the probe axis, position across it: the selection S, S' of [Zhang, Sec. V-B.2, Fig. 23].

The force error becomes a *rate* of the tip along its own axis, because a position offset proportional to the error
could not hold a set-point on an elastic surface without a standing error. Pure functions of
(measurement, reference, memory) -> memory, so that the twin and the robot run the same code.
"""

import math
from dataclasses import dataclass

from breastscan.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    """How the probe meets the skin and keeps its force."""

    force: float = 5.0
    """Set-point of the contact force along the probe axis [N]."""
    approach_speed: float = 0.01
    """Speed towards the skin until contact [m/s]."""
    search_depth: float = 0.015
    """How far beyond the planned skin the approach looks for contact before it gives up [m]."""
    contact_force: float = 0.5
    """Force that counts as contact [N]: ten sigma of an industrial six-axis sensor."""
    damping: float = 60.0
    """Force error per speed of correction, 1/gain of the admittance [N s/m]. With tissue of 1 kN/m this settles in
    60 ms, twice the lag of a UR controller's servoj."""
    rate_limit: float = 0.03
    """Bound of the correction's speed [m/s]."""
    acceleration: float = 0.5
    """Bound of its change, in approach and retreat as well [m/s^2]: from rest to `rate_limit` in 60 ms."""
    depth_limit: float = 0.02
    """Bound of the correction, in both directions from the planned skin [m]."""
    filter_hz: float = 25.0
    """Corner of the first-order low-pass on the measured force [Hz]."""
    ramp_time: float = 0.5
    """Time over which the set-point rises from first contact to its full value [s]."""
    settle_time: float = 2.0
    """Time from first contact to the start of the path [s]."""
    retreat_speed: float = 0.03
    """Speed away from the skin at the end [m/s]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"contact.{name} must be a positive number, not {value}", value)
        if self.contact_force >= self.force:
            raise ConfigError(
                f"contact.contact-force ({self.contact_force} N) must be below the set-point ({self.force} N)",
                self.force,
            )


@dataclass(frozen=True)
class ContactMemory:
    """What the controller carries from one period to the next."""

    depth: float
    """Displacement of the tip along its axis from the planned skin, positive into the tissue [m]."""
    rate: float = 0.0
    """Speed of that displacement [m/s]."""
    force: float = 0.0
    """Filtered contact force, positive when pressing [N]."""


def filter_force(memory: ContactMemory, measured: float, config: ContactConfig, period: float) -> float:
    """First-order low-pass of the measured force [N], exact for any period [s]."""
    weight = 1.0 - math.exp(-2.0 * math.pi * config.filter_hz * period)
    return memory.force + weight * (measured - memory.force)


def advance(
    memory: ContactMemory, measured: float, speed: float, config: ContactConfig, period: float
) -> ContactMemory:
    """Move along the axis at a given speed [m/s], whatever the force: approach and retreat.

    The speed is reached at `config.acceleration`.
    """
    force = filter_force(memory, measured, config, period)
    step = config.acceleration * period
    rate = min(max(speed, memory.rate - step), memory.rate + step)
    return ContactMemory(memory.depth + rate * period, rate, force)


def regulate(
    memory: ContactMemory, measured: float, set_point: float, config: ContactConfig, period: float
) -> ContactMemory:
    """One period of force control: the tip moves along its axis at (set-point - force) / damping.

    Args:
        memory: State after the last period.
        measured: Contact force along the probe axis, positive when pressing [N].
        set_point: Force wanted now [N].
        config: Gains and bounds.
        period: Control period [s].

    Returns:
        The state after this period; its depth stays inside `config.depth_limit` and is its own anti-windup.
    """
    force = filter_force(memory, measured, config, period)
    wanted = min(max((set_point - force) / config.damping, -config.rate_limit), config.rate_limit)
    moved = advance(memory, measured, wanted, config, period)
    if abs(moved.depth) <= config.depth_limit:
        return moved
    return ContactMemory(math.copysign(config.depth_limit, moved.depth), 0.0, force)


def ramped_set_point(time_in_contact: float, config: ContactConfig) -> float:
    """Set-point [N] at a time since first contact [s]: a straight ramp, which keeps the overshoot small."""
    share = min(time_in_contact / config.ramp_time, 1.0)
    return config.contact_force + share * (config.force - config.contact_force)
