"""Is the probe normal to the skin? The wrench says so, and the tilt is driven to zero within a
bound.

Skin without friction pushes along its own normal. A probe that is tilted about x therefore feels a
force along y; one that is tilted about y, along the array, touches with another part of its convex
face, so that the centre of pressure moves and a moment about y shows. Friction, which opposes the
motion across the skin, spoils the first signal and not the second, for it passes through the tip.
Its coefficient is learnt from what changes as the motion sets out, when the tilt does not.
"""

import math
from dataclasses import dataclass, replace

from breastscan.control.follower import stopping_speed, towards


@dataclass(frozen=True, kw_only=True)
class TiltConfig:
    """How the probe is rotated towards the normal."""

    force_gain: float = 0.9
    """Force along y over the pressing force, per tilt about x [1/rad]: 1 on skin much larger than
    the probe; measured on the twin, as the next one."""
    moment_gain: float = 0.031
    """Moment about y over the pressing force per tilt about y [m/rad]: half of the face's radius of
    60 mm."""
    time_constant: float = 1.0
    """Of the rotation towards the normal [s]."""
    filter_hz: float = 1.0
    """Corner of the low-pass on both signals [Hz]."""
    force_dead_band: float = math.radians(4.0)
    """Tilt about x that is left alone [rad]: 1 % of cross-talk in the sensor looks like .6 degrees,
    and what a small dense breast presses across a probe that stands square on it like three and
    more. Planned normals are better than that, so this is for plans that are wrong."""
    moment_dead_band: float = math.radians(8.0)
    """Tilt about y that is left alone [rad]: a force that the sensor, 160 mm away, reads 1 % too
    far across looks like 2.9 degrees, and skin that bends more on one side of the array than on
    the other like six."""
    bound: float = math.radians(8.0)
    """Largest correction about each axis [rad]."""
    rate_limit: float = math.radians(3.0)
    """Largest speed of it [rad/s]."""
    acceleration: float = 0.5
    """Largest change of that [rad/s^2]: a wrist joint takes up to twice as much, of the 40 that the
    supervisor allows."""
    min_force: float = 1.0
    """Pressing force below which the wrench says nothing about the tilt [N]."""
    max_noise: float = 0.1
    """Noise of the force beyond which the sensor's tilt is ignored [N]: an arm's built-in one has
    offsets of a newton across the axis, which look like ten degrees."""
    friction: float = 0.1
    """Coefficient of friction to begin with [-]: gel has .05 to .2."""
    friction_time: float = 1.0
    """Time constant of the high-pass through which the friction is learnt [s]."""


@dataclass(frozen=True)
class TiltMemory:
    """What the correction carries from one period to the next."""

    rx: float = 0.0
    """Rotation of the probe about its own x, against the plan [rad]."""
    ry: float = 0.0
    """The same about y [rad]."""
    rates: tuple[float, float] = (0.0, 0.0)
    """Their speeds [rad/s]."""
    fx: float = 0.0
    """Low-passed force along x over the pressing force [-]."""
    fy: float = 0.0
    """The same along y [-]."""
    my: float = 0.0
    """Low-passed moment about y over the pressing force [m]."""
    slow: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Slow part of fx, fy and of the direction of motion in x and y [-]."""
    learnt: tuple[float, float] = (0.0, 0.0)
    """What was learnt about the friction: correlation and weight [s]."""
    moving: tuple[float, float] = (0.0, 0.0)
    """Low-passed direction of motion across the axis, of length 1 in full motion [-]."""

    def friction(self, config: TiltConfig) -> float:
        """Coefficient of friction [-], as far as it is known."""
        correlation, weight = self.learnt
        prior = PRIOR_WEIGHT
        return (prior * config.friction - correlation) / (prior + weight)

    def tilt(self, config: TiltConfig) -> tuple[float, float]:
        """The tilt about x and y that is left, as the wrench tells it [rad]."""
        dragged = self.friction(config) * self.moving[1]
        return -(self.fy + dragged) / config.force_gain, -self.my / config.moment_gain


PRIOR_WEIGHT = 0.02
"""Weight of the friction that is assumed, in seconds of full excitation."""
CREEP = 2e-3
"""Speed across the skin below which friction is not fully there [m/s]."""


@dataclass(frozen=True)
class Drag:
    """What this period says about the tilt."""

    wrench: tuple[float, float, float, float]
    """Forces along x, y and z and moment about y, at the tip in P [N, N m]."""
    velocity: tuple[float, float]
    """Of the tip across the skin, along x and y of P [m/s]."""
    noise: float
    """Of the sensor's force [N]."""
    period: float
    """[s]"""


def update(now: Drag, memory: TiltMemory, config: TiltConfig) -> TiltMemory:
    """One period later; without contact, or with a sensor that is too noisy, the correction comes
    to rest.
    """
    pressing = -now.wrench[2]
    if pressing < config.min_force or now.noise > config.max_noise:
        return rest(memory, config, now.period)
    fast = 1.0 - math.exp(-2.0 * math.pi * config.filter_hz * now.period)
    fx = memory.fx + fast * (now.wrench[0] / pressing - memory.fx)
    fy = memory.fy + fast * (now.wrench[1] / pressing - memory.fy)
    my = memory.my + fast * (now.wrench[3] / pressing - memory.my)
    vx, vy = now.velocity
    speed = math.hypot(vx, vy, CREEP)
    ux = memory.moving[0] + fast * (vx / speed - memory.moving[0])
    uy = memory.moving[1] + fast * (vy / speed - memory.moving[1])
    slow, learnt = _learnt((fx, fy, ux, uy), memory, config, now.period)
    felt = TiltMemory(memory.rx, memory.ry, memory.rates, fx, fy, my, slow, learnt, (ux, uy))
    about_x, about_y = felt.tilt(config)
    wanted_x = _wanted_rate(about_x, config.force_dead_band, config)
    wanted_y = _wanted_rate(about_y, config.moment_dead_band, config)
    rx, x_rate = _turned(memory.rx, memory.rates[0], wanted_x, config, now.period)
    ry, y_rate = _turned(memory.ry, memory.rates[1], wanted_y, config, now.period)
    return TiltMemory(rx, ry, (x_rate, y_rate), fx, fy, my, slow, learnt, (ux, uy))


def rest(memory: TiltMemory, config: TiltConfig, period: float) -> TiltMemory:
    """One period [s] later, without a measurement: the correction stays, once it has come to
    rest.
    """
    if memory.rates == (0.0, 0.0):
        return memory
    rx, x_rate = _turned(memory.rx, memory.rates[0], 0.0, config, period)
    ry, y_rate = _turned(memory.ry, memory.rates[1], 0.0, config, period)
    return replace(memory, rx=rx, ry=ry, rates=(x_rate, y_rate))


def _learnt(
    signals: tuple[float, float, float, float],
    memory: TiltMemory,
    config: TiltConfig,
    period: float,
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:
    """Slow parts of the signals, and the friction's correlation and weight, one period on."""
    weight = period / config.friction_time
    sx, sy, svx, svy = (
        s + weight * (signal - s) for s, signal in zip(memory.slow, signals, strict=True)
    )
    hx = signals[0] - sx
    hy = signals[1] - sy
    hvx = signals[2] - svx
    hvy = signals[3] - svy
    correlation, known = memory.learnt
    return (sx, sy, svx, svy), (
        correlation + period * (hx * hvx + hy * hvy),
        known + period * (hvx * hvx + hvy * hvy),
    )


def _wanted_rate(tilt: float, dead_band: float, config: TiltConfig) -> float:
    """Speed of the correction [rad/s] that takes what leaves the dead band of the tilt [rad]
    away.
    """
    beyond = math.copysign(max(abs(tilt) - dead_band, 0.0), tilt)
    return min(max(-beyond / config.time_constant, -config.rate_limit), config.rate_limit)


def _turned(
    angle: float, rate: float, wanted: float, config: TiltConfig, period: float
) -> tuple[float, float]:
    """Angle [rad] and speed [rad/s] about one axis a period [s] on, at the wanted speed as far as
    the acceleration and the bound, before which it stops, allow.
    """
    acceleration = config.acceleration
    up = stopping_speed(config.bound - angle, acceleration)
    down = stopping_speed(config.bound + angle, acceleration)
    rate = towards(rate, min(max(wanted, -down), up), acceleration, period)
    return angle + rate * period, rate
