"""How a motion goes along its line: how fast, and how it flows into the next; and circles.

What the maker does inside of a blend is not published [UR-script, `movej`]; both laws here are
assumed: they keep within the blend radius and leave each line along its tangent.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.robot.joint_motion import Trapezoid

Vector3 = Float[np.ndarray, "3"]
RAMP = 1 / 3
"""Share of a motion's given time in which it speeds up, and slows down again [-]; assumed."""
BISECTIONS = 40
STRAIGHT, BACK = 0.01, 2.8
"""Turns of a corner between which an arc rounds it [rad]: nearly none needs no rounding, and nearly
a reversal leaves none."""
COLLINEAR = 1e-6
"""Sine of the angle below which three points are on a line."""


class Law:
    """The trapezoid from a speed to rest, of which `Trapezoid` is the part from the top on."""

    def __init__(
        self, length: float, speed: float, acceleration: float, start_speed: float = 0.0
    ) -> None:
        """Of a positive `length`, at most `speed` after a start at another one; harder than
        `acceleration` only where the arm could not stop in time otherwise [m or rad, s].
        """
        a = self.acceleration = max(acceleration, start_speed**2 / (2 * length))
        self._start = start_speed
        held = min(start_speed, speed)
        self._slowing = (start_speed - held) / a
        self._slowed = (start_speed**2 - held**2) / (2 * a)
        self._run_up, self._run_up_time = held**2 / (2 * a), held / a
        self._trapezoid = Trapezoid(length - self._slowed + self._run_up, speed, a)
        self._top = speed
        self.duration = self._slowing + self._trapezoid.duration - self._run_up_time
        """[s]"""

    @staticmethod
    def in_time(length: float, seconds: float, start_speed: float = 0.0) -> "Law":
        """The one that takes so long, or the slowest one, if that is not slow enough."""
        mean = length / seconds
        acceleration = mean / (1 - RAMP) / (RAMP * seconds)
        if start_speed == 0.0:
            return Law(length, mean / (1 - RAMP), acceleration)
        low, high = 0.0, start_speed + mean / (1 - RAMP)
        for _ in range(BISECTIONS):
            speed = (low + high) / 2
            slow = Law(length, speed, acceleration, start_speed).duration > seconds
            low, high = (speed, high) if slow else (low, speed)
        return Law(length, high, acceleration, start_speed)

    def distance(self, t: float) -> float:
        """Covered by the time `t` [s]."""
        if t < self._slowing:
            return (self._start - self.acceleration * t / 2) * t
        time = t - self._slowing + self._run_up_time
        return self._slowed + self._trapezoid.distance(time) - self._run_up

    def speed(self, t: float) -> float:
        """At the time `t` [s]."""
        if t < self._slowing:
            return self._start - self.acceleration * t
        time = t - self._slowing + self._run_up_time
        left = max(self._trapezoid.duration - time, 0.0)
        return min(self._top, self.acceleration * time, self.acceleration * left)


@dataclass(frozen=True)
class Corner:
    """From one line into the next."""

    duration: float
    """[s]"""
    progress: Callable[[float], tuple[float, float]]
    """Fraction of `duration` -> length left of the first line, length covered of the second."""
    end_speed: float
    """Along the second line."""


def parabola(left: float, covered: float, speed: float) -> Corner:
    """With constant acceleration, from `left` before the corner at `speed` to `covered` behind
    it.
    """
    duration = 2 * left / speed
    return Corner(duration, lambda u: ((1 - u) ** 2 * left, u**2 * covered), 2 * covered / duration)


def arc(left: float, speed: float, turn: float) -> Corner:
    """At constant speed round a circle that touches both lines `left` from the corner, at which
    the direction changes by `turn` [rad].
    """
    radius = left / math.tan(turn / 2)

    def progress(u: float) -> tuple[float, float]:
        sideways = radius * (1 - math.cos(u * turn)) / math.sin(turn)
        return left - radius * math.sin(u * turn) + sideways * math.cos(turn), sideways

    return Corner(radius * turn / speed, progress, speed)


@dataclass(frozen=True)
class Circle:
    """An arc through three points."""

    centre: Vector3
    start: Vector3
    """From the centre [m]."""
    axis: Vector3
    angle: float
    """About the axis, from the first point through the second to the third [rad]."""

    @staticmethod
    def through(first: Vector3, second: Vector3, third: Vector3) -> "Circle | None":
        """None where they are on a line."""
        a, b = second - first, third - first
        normal = np.cross(a, b)
        square = float(normal @ normal)
        if not square > COLLINEAR**2 * float(a @ a) * float(b @ b):
            return None
        to_centre = np.cross((a @ a) * b - (b @ b) * a, normal) / (2 * square)
        start, axis = -to_centre, normal / math.sqrt(square)
        x, y = start, np.cross(axis, start)
        end = b - to_centre
        return Circle(first + to_centre, start, axis, math.atan2(end @ y, end @ x) % (2 * math.pi))

    @property
    def radius(self) -> float:
        """[m]"""
        return float(np.linalg.norm(self.start))

    def point(self, fraction: float) -> Vector3:
        """On it [m]."""
        phi = fraction * self.angle
        y = np.cross(self.axis, self.start)
        return self.centre + math.cos(phi) * self.start + math.sin(phi) * y


@dataclass(frozen=True)
class Pace:
    """How fast a motion is asked to be; its given time counts before the rest [UR-script,
    `movej`].
    """

    speed: float
    """[m/s or rad/s]"""
    acceleration: float
    """[m/s^2 or rad/s^2]"""
    seconds: float = 0.0
    """That the whole takes [s]; 0 where speed and acceleration say it."""

    def law(self, length: float, whole: float, start_speed: float = 0.0) -> Law:
        """Along the last `length` of the `whole` line."""
        if self.seconds > 0:
            return Law.in_time(length, self.seconds * length / whole, start_speed)
        return Law(length, self.speed, self.acceleration, start_speed)

    def top_speed(self, whole: float) -> float:
        """Along the line, where it is long enough."""
        return whole / self.seconds / (1 - RAMP) if self.seconds > 0 else self.speed
