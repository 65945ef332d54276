"""Feedrate interpolation: a point of the curve for every control period, from rest to rest [Zhang,
Eqs. 23-31].

The speed along the curve is planned first, over the whole length, under limits on speed,
acceleration, jerk, normal acceleration and chord error. Then one step a period finds the parameter
whose chord from the last point has the planned length.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, no_type_check

import numba
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PPoly
from scipy.ndimage import minimum_filter1d

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.nurbs import Nurbs

LOOK_AHEAD_STEPS = 4096
"""Pieces of the curve, equal in length, on which its speed is planned."""
SLOW_FRACTION = 0.01
"""Fraction of the top speed below which the fluctuation is not counted: there rounding of the
coordinates shows."""
END_PASSES = 8
"""How often the steps are scaled to end on the curve's end, at most: each pass leaves about a
thousandth."""
END_TOLERANCE = 1e-13
"""Where that stops, as a fraction of the curve."""

Step = Literal["taylor1", "taylor2", "newton"]


@dataclass(frozen=True, kw_only=True)
class FeedrateLimits:
    """What the probe's motion along the curve must keep to."""

    speed: float = 0.025
    """Top speed [m/s]."""
    acceleration: float = 0.020
    """Along the curve [m/s^2]."""
    normal_acceleration: float = 0.020
    """Towards the centre of curvature [m/s^2]."""
    jerk: float = 0.2
    """Change of the acceleration along the curve [m/s^3]."""
    chord_error: float = 1e-6
    """Distance of the curve from the chord of one period [m]."""
    step: Step = "newton"
    """Taylor expansion of first or second order, or the latter and one Newton step on the chord's
    length."""

    def __post_init__(self) -> None:
        require_positive(self, "planning.feedrate")
        if self.step not in ("taylor1", "taylor2", "newton"):
            raise ConfigError(
                f"planning.feedrate.step must be taylor1, taylor2 or newton, got {self.step!r}",
                self.step,
            )

    def slowed(self, factor: float) -> "FeedrateLimits":
        """The limits of the same motion taking `factor` times as long."""
        return replace(
            self,
            speed=self.speed / factor,
            acceleration=self.acceleration / factor**2,
            normal_acceleration=self.normal_acceleration / factor**2,
            jerk=self.jerk / factor**3,
        )


@dataclass(frozen=True, kw_only=True)
class Feed:
    """The curve sampled every control period, at rest at both ends."""

    t: Float[np.ndarray, "n"]
    """Time from the start [s]."""
    u: Float[np.ndarray, "n"]
    """Curve parameters, 0 to 1."""
    s: Float[np.ndarray, "n"]
    """Length along the curve [m]."""
    positions: Float[np.ndarray, "n 3"]
    """Points on the curve [m]."""
    speeds: Float[np.ndarray, "n"]
    """Planned speed V(u_i) over the period that starts at each sample [m/s]; 0 at the last."""
    chord_error: float
    """Largest distance of the curve from the chord of a period [m]."""

    @property
    def fluctuation_pct(self) -> float:
        """Largest speed fluctuation |delta_i| [%] [Zhang, Eq. 25], where the speed is 1 % of the
        top speed or more.
        """
        chords = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        planned = self.speeds[:-1] * np.diff(self.t)
        fast = planned >= SLOW_FRACTION * planned.max()
        return 100.0 * float(np.max(np.abs(chords[fast] / planned[fast] - 1.0)))


def interpolate(curve: Nurbs, limits: FeedrateLimits, period: float) -> Feed:
    """Walk the whole curve once, from rest to rest.

    Args:
        curve: A curve in three dimensions [m].
        limits: What the motion keeps to.
        period: Control period T_s [s].

    Returns:
        The samples; the first is the curve's start and the last exactly its end. The duration is
        rounded up to whole periods, by going a little slower.

    Raises:
        PlanningError: The period is not positive, or the curve is too short to be walked in steps
            of it.
    """
    if not period > 0.0:
        raise PlanningError(f"the control period must be positive, got {period} s", period)
    s = _planned_lengths(curve, limits, period)
    u, steps = _end_to_end(curve, np.diff(s), limits.step)
    positions = curve.evaluate(u)
    return Feed(
        t=period * np.arange(len(u)),
        u=u,
        s=s,
        positions=positions,
        speeds=np.append(steps / period, 0.0),
        chord_error=_chord_error(curve, u, positions),
    )


def speed_limit(
    curvature: Float[np.ndarray, "n"], limits: FeedrateLimits, period: float
) -> Float[np.ndarray, "n"]:
    """Speed that chord error, normal acceleration and the top speed allow [m/s] [Zhang, Eqs. 26,
    27].

    Args:
        curvature: 1 / rho at each point [1/m].
        limits: What the motion keeps to.
        period: Control period T_s [s].
    """
    h = limits.chord_error
    rho = 1.0 / np.maximum(curvature, 1e-9)
    chord_speed = 2.0 / period * np.sqrt(rho**2 - np.maximum(rho - h, 0.0) ** 2)
    normal_speed = np.sqrt(rho * limits.normal_acceleration)
    return np.minimum(np.minimum(chord_speed, normal_speed), limits.speed)


def _planned_lengths(curve: Nurbs, limits: FeedrateLimits, period: float) -> np.ndarray:
    """Length along the curve at every period [m].

    An acceleration-limited motion, averaged over a sliding window of time, changes its acceleration
    by 2a over the window at most, so a window of 2a / jerk keeps the jerk limit. The average lags
    within the window, hence the speed limits are first widened along the curve by the distance that
    a window takes.
    """
    window = max(2.0 * limits.acceleration / limits.jerk, period)
    grid = np.linspace(0.0, curve.length, LOOK_AHEAD_STEPS + 1)
    limit = speed_limit(curve.curvature(curve.parameter(grid)), limits, period)
    reach = math.ceil(limits.speed * window / grid[1])
    limit = minimum_filter1d(limit, 2 * min(reach, LOOK_AHEAD_STEPS) + 1, mode="nearest")
    speed = _look_ahead(grid, limit, limits.acceleration)
    return _averaged_lengths(grid, speed, window, period)


def _look_ahead(s: np.ndarray, limit: np.ndarray, acceleration: float) -> np.ndarray:
    """Greatest speed from rest to rest under `limit` and the acceleration, forwards and
    backwards.
    """
    squared = limit**2
    squared[[0, -1]] = 0.0
    gain = 2.0 * acceleration * s
    forwards = np.minimum.accumulate(squared - gain) + gain
    backwards = np.minimum.accumulate((squared + gain)[::-1])[::-1] - gain
    return np.sqrt(np.maximum(np.minimum(forwards, backwards), 0.0))


def _averaged_lengths(s: np.ndarray, speed: np.ndarray, window: float, period: float) -> np.ndarray:
    """Length at every period of the motion with `speed` at lengths `s`, averaged over `window`
    [s].
    """
    durations = 2.0 * np.diff(s) / (speed[:-1] + speed[1:])
    t = np.append(0.0, np.cumsum(durations))
    length = PPoly(np.stack([np.diff(speed) / durations, speed[:-1]]), t).antiderivative()
    area = length.antiderivative()

    def area_until(time: np.ndarray) -> np.ndarray:
        return area(np.clip(time, 0.0, t[-1])) + s[-1] * np.maximum(time - t[-1], 0.0)

    periods = math.ceil((t[-1] + window) / period)
    time = np.linspace(0.0, t[-1] + window, periods + 1)
    averaged = (area_until(time) - area_until(time - window)) / window
    averaged[[0, -1]] = s[[0, -1]]
    return averaged


def _end_to_end(curve: Nurbs, steps: np.ndarray, step: Step) -> tuple[np.ndarray, np.ndarray]:
    """Parameters after each step, and the steps, scaled together until the last one ends at u = 1.

    Chords are shorter than the curve, so that they would overshoot its end (by some 1e-8 of its
    length).
    """
    end_speed = float(np.linalg.norm(curve.evaluate(1.0, 1)))
    scale = 1.0
    u = np.empty(len(steps) + 1)
    for _ in range(END_PASSES):
        u = _march(
            curve.breaks, curve.polynomials, scale * steps, step != "taylor1", step == "newton"
        )
        if abs(u[-1] - 1.0) < END_TOLERANCE:
            break
        scale += (1.0 - u[-1]) * end_speed / curve.length
    u[-1] = 1.0
    if not (np.diff(u) > 0.0).all():
        raise PlanningError(
            f"the curve of {curve.length * 1e3:.3g} mm cannot be walked in {len(steps)} steps: it "
            "stands still or doubles back on itself somewhere, so use fewer or other points",
            curve.length,
        )
    return u, scale * steps


def _chord_error(curve: Nurbs, u: np.ndarray, positions: np.ndarray) -> float:
    """Distance of the curve at mid-parameter from the centre of the chord, across the chord."""
    chords = np.diff(positions, axis=0)
    offset = curve.evaluate((u[:-1] + u[1:]) / 2.0) - (positions[:-1] + positions[1:]) / 2.0
    along = np.sum(offset * chords, axis=1) / np.maximum(np.sum(chords**2, axis=1), 1e-30)
    return float(np.linalg.norm(offset - along[:, None] * chords, axis=1).max())


@numba.njit(cache=True)
@no_type_check  # keeps the tests' run-time type checker from wrapping what numba compiles
def _march(breaks, polynomials, steps, second_order, newton):
    """Parameters whose chords have the lengths `steps` [Zhang, Eq. 29, corrected].

    V T_s + A T_s^2 / 2, the distance of one period under acceleration A, is the step itself: u' = u
    + step / |C'| - step^2 (C'.C'') / (2 |C'|^4), then Newton's method on |C(u') - C(u)|^2 = step^2.
    """
    u = np.zeros(len(steps) + 1)
    here, there = np.empty((3, 3)), np.empty((3, 3))
    span = 0
    for i in range(len(steps)):
        span = _evaluate(breaks, polynomials, u[i], span, here)
        squared = np.sum(here[1] ** 2)
        change = steps[i] / math.sqrt(squared)
        if second_order:
            change -= steps[i] ** 2 * np.sum(here[1] * here[2]) / (2.0 * squared**2)
        if newton:
            _evaluate(breaks, polynomials, u[i] + change, span, there)
            chord = there[0] - here[0]
            change -= (np.sum(chord**2) - steps[i] ** 2) / (2.0 * np.sum(chord * there[1]))
        u[i + 1] = u[i] + change
    return u


@numba.njit(cache=True)
@no_type_check
def _evaluate(breaks, polynomials, u, span, out):
    """C, C' and C'' at u into `out`, and the span of u, sought from `span` on."""
    while span < len(breaks) - 2 and u >= breaks[span + 1]:
        span += 1
    x = u - breaks[span]
    c = polynomials[span]
    w = ((c[0, 3] * x + c[1, 3]) * x + c[2, 3]) * x + c[3, 3]
    w1 = (3.0 * c[0, 3] * x + 2.0 * c[1, 3]) * x + c[2, 3]
    w2 = 6.0 * c[0, 3] * x + 2.0 * c[1, 3]
    for axis in range(3):
        h = ((c[0, axis] * x + c[1, axis]) * x + c[2, axis]) * x + c[3, axis]
        h1 = (3.0 * c[0, axis] * x + 2.0 * c[1, axis]) * x + c[2, axis]
        h2 = 6.0 * c[0, axis] * x + 2.0 * c[1, axis]
        out[0, axis] = h / w
        out[1, axis] = (h1 - w1 * out[0, axis]) / w
        out[2, axis] = (h2 - 2.0 * w1 * out[1, axis] - w2 * out[0, axis]) / w
    return span
