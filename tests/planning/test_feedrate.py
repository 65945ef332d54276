import numpy as np
import pytest

from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.nurbs import Nurbs
from breastscan.geometry.nurbs_system import homogeneous_spline
from breastscan.planning import feedrate
from breastscan.planning.feedrate import FeedrateLimits

PERIOD = 0.002
SHARP_WEIGHTS = np.array(
    [1.0, 5.0, 1.0, 0.2, 1.0, 3.0, 1.0, 1.0, 4.0, 1.0, 0.3, 1.0, 1.0, 2.0, 1.0]
)


def loop(weights: np.ndarray | None = None, half_width: float = 0.073) -> Nurbs:
    angle = np.linspace(0.0, 2 * np.pi, 15, endpoint=False)
    ring = np.stack(
        [0.5 + 0.045 * np.cos(angle), half_width * np.sin(angle), 0.1 + 0.003 * np.sin(3 * angle)],
        axis=1,
    )
    return Nurbs.interpolate(ring, weights=weights)


def chord_speeds(feed: feedrate.Feed) -> np.ndarray:
    return np.linalg.norm(np.diff(feed.positions, axis=0), axis=1) / PERIOD


def test_loop_is_walked_from_rest_to_rest_exactly_once():
    curve = loop()
    feed = feedrate.interpolate(curve, FeedrateLimits(), PERIOD)
    assert (feed.u[0], feed.u[-1]) == (0.0, 1.0)
    np.testing.assert_array_equal(feed.positions[-1], feed.positions[0])
    assert np.all(np.diff(feed.u) > 0.0)
    assert np.all(chord_speeds(feed)[[0, -1]] < 1e-6)
    np.testing.assert_allclose(feed.s, curve.arc_length(feed.u), atol=1e-8)


def test_speed_acceleration_and_jerk_stay_inside_their_limits():
    limits = FeedrateLimits()
    speeds = np.concatenate(
        [[0.0], chord_speeds(feedrate.interpolate(loop(), limits, PERIOD)), [0.0]]
    )
    acceleration = np.diff(speeds) / PERIOD
    assert speeds.max() <= limits.speed * (1 + 1e-7)
    assert speeds.max() > 0.99 * limits.speed
    assert np.abs(acceleration).max() <= limits.acceleration * (1 + 1e-3)
    assert np.abs(np.diff(acceleration) / PERIOD).max() <= limits.jerk * (1 + 1e-3)


def test_normal_acceleration_slows_the_sharp_ends_of_an_oval_loop():
    limits, curve = FeedrateLimits(), loop()
    feed = feedrate.interpolate(curve, limits, PERIOD)
    normal_acceleration = chord_speeds(feed) ** 2 * curve.curvature(feed.u[:-1])
    assert curve.curvature(feed.u).max() > 1.0 / 0.031  # so the limit binds
    assert normal_acceleration.max() <= limits.normal_acceleration * 1.005
    assert normal_acceleration.max() > 0.95 * limits.normal_acceleration


def test_chord_error_limit_binds_where_it_is_tight():
    limits = FeedrateLimits(chord_error=2e-9)
    feed = feedrate.interpolate(loop(), limits, PERIOD)
    assert feed.chord_error == pytest.approx(limits.chord_error, rel=0.05)
    assert feedrate.interpolate(loop(), FeedrateLimits(), PERIOD).chord_error < 1e-6


@pytest.mark.parametrize("weights", [None, SHARP_WEIGHTS])
def test_speed_fluctuates_less_with_every_order_and_less_than_a_millionth_of_a_percent_with_newton(
    weights,
):
    fluctuation = {
        step: feedrate.interpolate(loop(weights), FeedrateLimits(step=step), PERIOD).fluctuation_pct
        for step in ("taylor1", "taylor2", "newton")
    }
    assert fluctuation["newton"] < 1e-6
    assert fluctuation["newton"] < 0.1 * fluctuation["taylor2"]
    assert fluctuation["taylor2"] < 0.1 * fluctuation["taylor1"]


def test_second_order_step_accounts_for_the_acceleration():
    limits = FeedrateLimits(speed=0.005, acceleration=0.5, jerk=50.0, step="taylor2")
    feed = feedrate.interpolate(loop(), limits, PERIOD)
    assert feed.fluctuation_pct < 1e-3  # 9 % where the acceleration is left out


def test_speed_limit_on_a_circle_follows_the_smaller_of_chord_and_normal_acceleration():
    rho = 0.060
    limits = FeedrateLimits(speed=10.0)
    expected_chord = 2 / PERIOD * np.sqrt(rho**2 - (rho - 1e-6) ** 2)
    assert expected_chord == pytest.approx(0.346, abs=1e-3)
    limit = feedrate.speed_limit(np.array([1 / rho]), limits, PERIOD)[0]
    assert limit == pytest.approx(np.sqrt(rho * 0.020))
    weak = FeedrateLimits(speed=10.0, normal_acceleration=1e6)
    assert feedrate.speed_limit(np.array([1 / rho]), weak, PERIOD)[0] == pytest.approx(
        expected_chord
    )


def test_short_curve_that_never_reaches_full_speed_is_still_walked_to_its_end():
    points = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.002, 0.0, 0.0], [0.003, 0.0, 0.0]])
    feed = feedrate.interpolate(Nurbs.interpolate(points, closed=False), FeedrateLimits(), PERIOD)
    np.testing.assert_allclose(feed.positions[-1], points[-1], atol=1e-15)
    assert chord_speeds(feed).max() < 0.01


@pytest.mark.parametrize(
    "name", ["speed", "acceleration", "normal_acceleration", "jerk", "chord_error"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_limits_that_are_not_positive_are_named(name, value):
    with pytest.raises(ConfigError, match=name):
        FeedrateLimits(**{name: float(value)})


def test_period_must_be_positive():
    with pytest.raises(PlanningError, match="period"):
        feedrate.interpolate(loop(), FeedrateLimits(), 0.0)


def eight() -> Nurbs:
    angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    return Nurbs.interpolate(
        np.stack([0.06 * np.sin(angle), 0.03 * np.sin(2 * angle), 0 * angle], axis=1) + 0.4
    )


def square(points_a_side: int) -> Nurbs:
    t = np.linspace(0.0, 0.1, points_a_side, endpoint=False)
    low, high = 0 * t, 0 * t + 0.1
    x, y = np.hstack([t, high, 0.1 - t, low]), np.hstack([low, t, high, 0.1 - t])
    return Nurbs.interpolate(np.stack([x, y, 0 * x], axis=1) + 0.4)


def hairpin(gap: float) -> Nurbs:
    x = np.linspace(0.0, 0.1, 8)
    there = np.stack([x, 0 * x, 0 * x], axis=1)
    return Nurbs.interpolate(
        np.vstack([there, np.add(there[::-1], [0.0, gap, 0.0])]) + 0.4, closed=False
    )


def bezier(*vertices: tuple[float, float]) -> Nurbs:
    """A cubic of four vertices [mm]."""
    control = np.column_stack([1e-3 * np.array(vertices), np.zeros(4)]) + 0.4
    knots = np.repeat([0.0, 1.0], 4)
    return Nurbs(spline=homogeneous_spline(control, np.ones(4), knots, False), closed=False)


def near_cusp(off: float) -> Nurbs:
    """Turns on the spot half-way, the more sharply the smaller `off` is [mm]."""
    return bezier((0, 0), (100 + off, 100), (0, 100), (100, 0))


def weighted(weight: float, vertices: int) -> Nurbs:
    weights = np.ones(15)
    weights[4 : 4 + vertices] = weight
    return loop().with_weights(weights)


def optimal_time(curve: Nurbs, limits: FeedrateLimits) -> float:
    """Of the fastest motion without a limit on the jerk, by integration in the phase plane on
    parameters that are even in every span [s].
    """
    steps = np.linspace(0.0, 1.0, 4000, endpoint=False)
    u = np.append((curve.breaks[:-1, None] + np.diff(curve.breaks)[:, None] * steps).ravel(), 1.0)
    ds = np.linalg.norm(curve.evaluate((u[:-1] + u[1:]) / 2, 1), axis=1) * np.diff(u)
    rho = 1 / np.maximum(curve.curvature(u), 1e-9)
    h = np.minimum(limits.chord_error, rho)
    chord = 2 / PERIOD * np.sqrt(h * (2 * rho - h))
    squared = np.minimum(np.minimum(limits.speed, chord) ** 2, limits.normal_acceleration * rho)
    squared[[0, -1]] = 0.0
    gain = 2 * limits.acceleration * ds
    for i in range(len(ds)):
        squared[i + 1] = min(squared[i + 1], squared[i] + gain[i])
    for i in range(len(ds) - 1, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + gain[i])
    return float(np.sum(2 * ds / (np.sqrt(squared[1:]) + np.sqrt(squared[:-1]))))


FIGURES = [loop(), eight(), square(5), square(20), hairpin(2e-3), hairpin(1e-4)]
NAMES = ["ring", "eight", "square", "square of 80 points", "hairpin", "narrow hairpin"]


@pytest.mark.parametrize("curve", FIGURES, ids=NAMES)
@pytest.mark.parametrize(
    ("jerk", "ratio"), [(1e6, 1.005), (2.0, 1.02), (0.2, 1.06)], ids=["no jerk", "hard", "soft"]
)
def test_the_motion_takes_hardly_longer_than_the_fastest_there_is(curve, jerk, ratio):
    """The latter knows no limit on the jerk."""
    limits = FeedrateLimits(jerk=jerk)
    feed = feedrate.interpolate(curve, limits, PERIOD)
    fastest = optimal_time(curve, limits)
    assert 0.999 * fastest < feed.t[-1] < ratio * fastest


SHARP = [hairpin(1e-5), near_cusp(-1.0), near_cusp(1.0), weighted(1e3, 1), weighted(1e3, 3)]
SHARP += [weighted(1e-3, 2), weighted(1e4, 3), square(80)]


@pytest.mark.parametrize("curve", [*FIGURES, *SHARP])
@pytest.mark.parametrize("jerk", [1e6, 0.2])
def test_normal_acceleration_is_kept_in_the_shortest_bend(curve, jerk):
    """By the radius of the circle through the ends and the middle of each period's step, which
    the curvature that was planned with has no part in.
    """
    limits = FeedrateLimits(jerk=jerk)
    feed = feedrate.interpolate(curve, limits, PERIOD)
    a, b = feed.positions[:-1], feed.positions[1:]
    middle = curve.evaluate((feed.u[:-1] + feed.u[1:]) / 2)
    sides = [np.linalg.norm(p - q, axis=1) for p, q in ((a, middle), (middle, b), (a, b))]
    area = np.linalg.norm(np.cross(middle - a, b - a), axis=1) / 2
    long = sides[2] > 1e-7  # shorter ones drown in rounding
    curvature = 4 * area[long] / np.prod(sides, axis=0)[long]
    used = chord_speeds(feed)[long] ** 2 * curvature / limits.normal_acceleration
    assert 0.9 < used.max() < 1.01
    assert feed.chord_error <= 1.02 * limits.chord_error


@pytest.mark.parametrize("curve", [*FIGURES, *SHARP])
def test_the_other_limits_are_kept_on_sharp_curves(curve):
    limits = FeedrateLimits()
    speeds = np.concatenate(
        [[0.0], chord_speeds(feedrate.interpolate(curve, limits, PERIOD)), [0.0]]
    )
    acceleration = np.diff(speeds) / PERIOD
    assert speeds.max() <= limits.speed * (1 + 1e-6)
    assert np.abs(acceleration).max() <= limits.acceleration * (1 + 2e-3)
    assert np.abs(np.diff(acceleration) / PERIOD).max() <= limits.jerk * (1 + 2e-2)


def back_and_forth() -> Nurbs:
    x = np.array([0.0, 0.05, 0.1, 0.05, 0.01])
    return Nurbs.interpolate(np.stack([x, 0 * x, 0 * x], axis=1) + 0.4, closed=False)


@pytest.mark.parametrize("curve", [back_and_forth(), near_cusp(0.0)], ids=["line", "cusp"])
def test_a_curve_that_turns_back_on_itself_is_refused_with_the_place(curve):
    place = 100 if curve.breaks.size > 2 else 1e3 * curve.length / 2
    with pytest.raises(PlanningError, match="turns back on itself") as refused:
        feedrate.interpolate(curve, FeedrateLimits(), PERIOD)
    assert 1e3 * refused.value.value == pytest.approx(place, abs=0.5)


@pytest.mark.parametrize("name", ["speed", "acceleration", "normal_acceleration", "jerk"])
@pytest.mark.parametrize("value", [1e-6, 1e-4, 1e3, 1e12])
@pytest.mark.parametrize("size", [1e-7, 1e-4])
def test_limits_of_any_size_end_in_a_motion_that_keeps_them(name, value, size):
    curve = Nurbs.interpolate(size * np.eye(4)[:, :3] + 0.4)
    limits = FeedrateLimits(**{name: value})
    feed = feedrate.interpolate(curve, limits, PERIOD)
    assert (np.diff(feed.u) >= 0.0).all()
    np.testing.assert_allclose(feed.positions[[0, -1]], curve.evaluate(np.array([0.0, 1.0])))
    assert feed.speeds.max() <= limits.speed * (1 + 1e-6)
    planned = np.diff(np.append(0.0, feed.speeds)) / PERIOD
    assert np.abs(planned).max() <= limits.acceleration * (1 + 1e-3)


def test_a_motion_of_too_many_periods_is_refused_with_its_time():
    with pytest.raises(PlanningError, match=r"3\.78e\+05 s, .* raise the limits"):
        feedrate.interpolate(loop(), FeedrateLimits(speed=1e-6), PERIOD)


def test_a_slow_motion_is_as_even_as_a_fast_one():
    points = np.array([[0.0, 0, 0], [1e-3, 0, 0], [2e-3, 0, 0], [3e-3, 0, 0]])
    curve = Nurbs.interpolate(points + 0.4, closed=False)
    feed = feedrate.interpolate(curve, FeedrateLimits(speed=1e-5), PERIOD)
    assert feed.t[-1] == pytest.approx(300.0, abs=0.3)
    assert feed.fluctuation_pct < 1e-3


def test_a_fine_chord_error_does_not_stop_a_straight_line():
    points = np.outer(np.linspace(0, 0.1, 4), [1.0, 0, 0])
    curve = Nurbs.interpolate(points, closed=False)
    times = [
        feedrate.interpolate(curve, FeedrateLimits(chord_error=h), PERIOD).t[-1]
        for h in (1e-12, 1e-6)
    ]
    assert times[0] == times[1]


@pytest.mark.parametrize("length", [1e-9, 1e-12])
def test_a_curve_that_drowns_in_rounding_is_refused(length):
    points = np.outer(np.linspace(0, length, 4), [1.0, 0, 0]) + 0.4
    with pytest.raises(PlanningError, match="drowns in the rounding"):
        feedrate.interpolate(Nurbs.interpolate(points, closed=False), FeedrateLimits(), PERIOD)


def test_a_wider_limit_of_acceleration_takes_no_longer():
    """Though more of it takes longer to reach at the same jerk."""
    times = [
        feedrate.interpolate(loop(), FeedrateLimits(acceleration=a), PERIOD).t[-1]
        for a in (0.02, 0.2, 2.0, 200.0)
    ]
    assert np.diff(times).max() <= 0.1
    assert times[-1] < times[0]
