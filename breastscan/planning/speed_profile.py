"""Speed along a curve from rest to rest: the fastest under a limit that varies along the curve, on
the acceleration and on the jerk.

A motion with limited acceleration, averaged over a sliding window of time, changes its acceleration
by twice the limit over the window at most, so a window of 2 a / jerk keeps the jerk.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry.compiled import kernel
from breastscan.geometry.nurbs import Nurbs

PIECES = 4096
"""Of the curve, equal in length, between which its speed limit is looked up."""
PARTS = 16
"""Of each piece over which the curve's length is smooth: it holds one bend or two."""
STEP_RATIO = 1.02
"""Of the speed limit from one place to the next at most."""
DIP_RATIO = 1.002
"""The same beside a place where it is lowest."""
STEP_SHARE = 0.25
"""Of a control period's way: finer pieces show nothing."""
MOST_PLACES = 1_000_000
"""To look a limit up at, where it is made of rounding errors."""
SHORTEST = 1e-8
"""Length of a curve, as a fraction of its coordinates, below which these are too coarse for it."""
NEEDLE = 1e-12
"""Radius, as a fraction of the curve's length, below which it counts as turning back on itself."""
MOST_PERIODS = 10_000_000
"""A plan may last: 5 hours at 500 Hz, and 1 GB."""


@dataclass(frozen=True, kw_only=True)
class SpeedLimit:
    """Places along a curve, and the speed that is allowed there."""

    s: Float[np.ndarray, "n"]
    """Length from the start, rising from 0 to the curve's [m]."""
    speed: Float[np.ndarray, "n"]
    """[m/s]"""


def sample_limit(
    curve: Nurbs,
    allowed: Callable[[Float[np.ndarray, "k"]], Float[np.ndarray, "k"]],
    period: float,
) -> SpeedLimit:
    """The limit at equal pieces of the curve, and more closely wherever it changes.

    Args:
        curve: A curve in three dimensions [m].
        allowed: Speed at a curvature [1/m], not above that on a straight line [m/s].
        period: Control period [s].

    Raises:
        PlanningError: The curve is too short, or all but turns back on itself somewhere.
    """
    if not curve.length > SHORTEST * np.abs(curve.control_points).max():
        raise PlanningError(
            f"the curve is {curve.length * 1e3:.3g} mm long, which drowns in the rounding of its "
            "coordinates: use points that are farther apart",
            curve.length,
        )
    u, s = _places(curve)
    curvature = _curvature(curve, u)
    sharpest = int(np.argmax(curvature))
    if curvature[sharpest] * curve.length * NEEDLE > 1.0:
        raise PlanningError(
            f"the curve turns back on itself {s[sharpest] * 1e3:.3g} mm from its start (of "
            f"{curve.length * 1e3:.3g} mm), where nothing can follow it but by standing still: use "
            "fewer or other points",
            float(s[sharpest]),
        )
    limit = allowed(curvature)
    while len(s) < MOST_PLACES:
        coarse = _coarse(limit, np.diff(s) / period)
        if not coarse.any():
            break
        middle = (u[:-1] + u[1:]) / 2.0
        after = np.flatnonzero(coarse) + 1
        u = np.insert(u, after, middle[coarse])
        s = np.insert(s, after, np.clip(curve.arc_length(middle[coarse]), s[after - 1], s[after]))
        limit = np.insert(limit, after, allowed(_curvature(curve, middle[coarse])))
    rising = np.append(True, np.diff(s) > 0.0)
    return SpeedLimit(s=s[rising], speed=limit[rising])


def _places(curve: Nurbs) -> tuple[np.ndarray, np.ndarray]:
    """Parameters, and lengths up to each [m]: equal pieces of the curve, and equal parts of the
    pieces over which its length is a smooth function of u.
    """
    equal = curve.parameter(np.linspace(0.0, curve.length, PIECES + 1))
    smooth = curve.smooth_pieces
    parts = smooth[:-1, None] + np.diff(smooth)[:, None] * np.linspace(0, 1, PARTS, endpoint=False)
    u = np.unique(np.append(equal, parts))
    return u, np.maximum.accumulate(curve.arc_length(u))


def _coarse(limit: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """Which of the pieces between the places, in lengths a period, are to be halved."""
    lower, upper = np.minimum(limit[:-1], limit[1:]), np.maximum(limit[:-1], limit[1:])
    steep = np.pad(upper > DIP_RATIO * lower, 1)
    # on either side of a place where it is lowest, it may be lower still
    around = np.pad(limit, 1, constant_values=np.inf)
    dip = (limit <= np.minimum(around[:-2], around[2:])) & (steep[:-1] | steep[1:])
    changes = (upper > STEP_RATIO * lower) | dip[:-1] | dip[1:]
    return changes & (pieces > STEP_SHARE * lower)


def _curvature(curve: Nurbs, u: np.ndarray) -> np.ndarray:
    """Of the curve [1/m]; infinite where it stands still."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(curve.curvature(u), nan=np.inf)


def fastest_lengths(
    limit: SpeedLimit, acceleration: float, jerk: float, period: float
) -> Float[np.ndarray, "n"]:
    """Length along the curve at every period [m], from rest to rest.

    Args:
        limit: On the speed.
        acceleration: Its limit [m/s^2]. Half of it and less is tried as well: what that takes
            longer, the shorter window may take less.
        jerk: Its limit [m/s^3].
        period: Control period [s].

    Raises:
        PlanningError: It would take too many periods.
    """
    halvings = max(0, int(np.log2(2.0 * acceleration / jerk / period)))
    best, least = None, np.inf
    for tried in acceleration / 2.0 ** np.arange(halvings, -1, -1):
        window = max(2.0 * tried / jerk, period)
        if window / period > least:
            break
        widened = _widened(limit.s, limit.speed, window / 2.0 + period)
        speed = _look_ahead(limit.s, widened, tried)
        t = np.append(0.0, np.cumsum(2.0 * np.diff(limit.s) / (speed[:-1] + speed[1:])))
        periods = np.ceil((t[-1] + window) / period)
        if periods <= least:
            best, least = (t, speed, window), periods
    if best is None or least > MOST_PERIODS:
        raise PlanningError(
            f"the path would take {least * period:.3g} s, {least:.3g} control periods where "
            f"{MOST_PERIODS} are the most: raise the limits of planning.feedrate",
            float(least * period),
        )
    t, speed, window = best
    times = np.linspace(0.0, t[-1] + window, int(least) + 1)
    lengths = _averaged(limit.s, speed, t, times, window)
    lengths[[0, -1]] = limit.s[[0, -1]]
    return lengths


@kernel
def _widened(s, limit, time):
    """The limit that a motion keeps to so that its average keeps to `limit`: no more than a place
    allows wherever that speed comes from, or leads to, within the time.

    The average comes to a place half a window after the motion, and what happens within half a
    window of that enters it. The period's steps take a period on either side.
    """
    widened = np.empty(s.size)
    for i in range(s.size):
        v = limit[i]
        for way in (-1, 1):
            j = i + way
            while 0 <= j < s.size and abs(s[j] - s[i]) < v * time:
                v = min(v, max(limit[j], abs(s[j] - s[i]) / time))
                j += way
        widened[i] = v
    return widened


@kernel
def _look_ahead(s, limit, acceleration):
    """Greatest speed from rest to rest under the limit and the acceleration, forwards and
    backwards.
    """
    squared = limit**2
    squared[0] = squared[-1] = 0.0
    for i in range(1, s.size):
        squared[i] = min(squared[i], squared[i - 1] + 2.0 * acceleration * (s[i] - s[i - 1]))
    for i in range(s.size - 2, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2.0 * acceleration * (s[i + 1] - s[i]))
    return np.sqrt(squared)


@kernel
def _averaged(s, speed, t, times, window):
    """Mean length over the window before each of the times, of the motion that is at `s` at `t`.

    It counts from where the window begins: small steps would drown in the whole length's integral.
    """
    lengths = np.empty(times.size)
    first = 0
    for k in range(times.size):
        begin = times[k] - window
        while first < t.size - 2 and t[first + 1] <= begin:
            first += 1
        ahead = max(begin - t[first], 0.0)
        origin = s[first] + ahead * (speed[first] + ahead * _gain(speed, t, first) / 2.0)
        total = (s[-1] - origin) * max(times[k] - t[-1], 0.0)
        p = first
        while p < t.size - 1 and t[p] < times[k]:
            x, y = max(begin - t[p], 0.0), min(times[k], t[p + 1]) - t[p]
            if y > x:
                total += (s[p] - origin) * (y - x) + speed[p] * (y**2 - x**2) / 2.0
                total += _gain(speed, t, p) * (y**3 - x**3) / 6.0
            p += 1
        lengths[k] = origin + total / window
    return lengths


@kernel
def _gain(speed, t, p):
    """Acceleration over piece p."""
    duration = t[p + 1] - t[p]
    return (speed[p + 1] - speed[p]) / duration if duration > 0.0 else 0.0
