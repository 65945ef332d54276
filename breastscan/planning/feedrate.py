"""Feedrate interpolation: a point of the curve for every control period, from rest to rest [Zhang,
Eqs. 23-31].

The speed along the curve is planned first, over the whole length (`planning.speed_profile`), under
limits on speed, acceleration, jerk, normal acceleration and chord error. Then one step a period
finds the parameter whose chord from the last point has the planned length.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.compiled import kernel
from breastscan.geometry.nurbs import Nurbs
from breastscan.planning.speed_profile import fastest_lengths, sample_limit

SLOW_FRACTION = 0.01
"""Fraction of the top speed below which the fluctuation is not counted: there rounding of the
coordinates shows."""
END_PASSES = 30
"""How often the steps are scaled to end on the curve's end, at most: each pass leaves about a
thousandth, of a few coarse steps more."""
END_TOLERANCE = 1e-13
"""Where that stops, as a fraction of the curve."""
END_ERROR = 1e-6
"""What may be left then, where the coordinates' rounding does not let it come closer."""
NEWTON_STEPS = 12
"""On a chord's length at most; but for the sharpest corners one does."""
CLOSE = 1e-3
"""Of a step: what less is left before a Newton step, that takes to its square."""
UNSEEN = 1e-14
"""Step, as a fraction of the curve, that may drown in the rounding of the parameter."""

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
        PlanningError: The period is not positive, the curve turns back on itself or is too short to
            be walked in steps of it, or the limits would make it too many.
    """
    if not period > 0.0:
        raise PlanningError(f"the control period must be positive, got {period} s", period)
    limit = sample_limit(curve, lambda curvature: speed_limit(curvature, limits, period), period)
    s = fastest_lengths(limit, limits.acceleration, limits.jerk, period)
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
    rho = 1.0 / np.maximum(curvature, 1e-9)
    h = np.minimum(limits.chord_error, rho)
    chord_speed = 2.0 / period * np.sqrt(h * (2.0 * rho - h))  # rho^2 - (rho - h)^2, without loss
    normal_speed = np.sqrt(rho * limits.normal_acceleration)
    return np.minimum(np.minimum(chord_speed, normal_speed), limits.speed)


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
    moves = (np.diff(u) > 0.0) | ((np.diff(u) == 0.0) & (steps < UNSEEN * curve.length))
    if not (abs(u[-1] - 1.0) < END_ERROR and moves.all()):
        raise PlanningError(
            f"the curve of {curve.length * 1e3:.3g} mm cannot be walked in {len(steps)} steps: it "
            "stands still or doubles back on itself somewhere, so use fewer or other points; or it "
            "is too short, or the limits of planning.feedrate too wide for its period",
            curve.length,
        )
    u /= u[-1]  # the last steps may be smaller than what is left
    return u, scale * steps


def _chord_error(curve: Nurbs, u: np.ndarray, positions: np.ndarray) -> float:
    """Distance of the curve at mid-parameter from the centre of the chord, across the chord."""
    chords = np.diff(positions, axis=0)
    offset = curve.evaluate((u[:-1] + u[1:]) / 2.0) - (positions[:-1] + positions[1:]) / 2.0
    along = np.sum(offset * chords, axis=1) / np.maximum(np.sum(chords**2, axis=1), 1e-30)
    return float(np.linalg.norm(offset - along[:, None] * chords, axis=1).max())


@kernel
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
        for _ in range(NEWTON_STEPS if newton else 0):
            _evaluate(breaks, polynomials, u[i] + change, span, there)
            chord = there[0] - here[0]
            excess = (np.sum(chord**2) - steps[i] ** 2) / (2.0 * np.sum(chord * there[1]))
            if not abs(excess) < np.inf:
                break  # a step that drowns in the rounding of the coordinates
            change = max(change - excess, change / 4.0)  # forwards, whatever a corner does to it
            if abs(excess) < CLOSE * change:
                break
        u[i + 1] = u[i] + change
    return u


@kernel
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
