import numpy as np
import pytest

from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.nurbs import Nurbs
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
