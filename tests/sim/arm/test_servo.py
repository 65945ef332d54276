"""The law of servoj against the closed form of the second-order system that it is."""

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.robot.ur.ur5e import PERIOD
from sim.arm.servo import ServoConfig, ServoJ

SETTINGS = [(0.03, 2000.0), (0.03, 300.0), (0.1, 300.0), (0.2, 2000.0), (0.1, 100.0)]


def followed(config, targets):
    """Where the first joint is to be as each target is sent [rad]."""
    servo = ServoJ(config, np.full(6, targets[0]))
    places = []
    for target in targets:
        places.append(servo.q_end[0])
        servo.follow(np.full(6, target))
    return np.array(places)


@pytest.mark.parametrize(("lookahead", "gain"), SETTINGS)
def test_a_ramp_is_followed_late_by_transport_and_lookahead_whatever_the_gain(lookahead, gain):
    config = ServoConfig(lookahead_time=lookahead, gain=gain)
    speed = 0.3
    ramp = speed * PERIOD * np.arange(2000)
    lag = (ramp - followed(config, ramp))[-1] / speed
    assert lag == pytest.approx(0.004 + lookahead, abs=1e-4)
    assert lag == pytest.approx(config.servo.lag, abs=1e-4)


def test_the_fastest_setting_lags_34_ms():
    assert ServoConfig().servo.lag == pytest.approx(0.034)


@pytest.mark.parametrize(("lookahead", "gain"), SETTINGS)
def test_a_step_overshoots_as_its_damping_says(lookahead, gain):
    """Textbook: exp(-pi zeta / sqrt(1 - zeta^2)), with zeta = lookahead sqrt(gain) / 2
    (continuous time).
    """
    step = np.r_[0.0, np.ones(3000)]
    overshoot = followed(ServoConfig(lookahead_time=lookahead, gain=gain), step).max() - 1
    damping = lookahead * np.sqrt(gain) / 2
    expected = np.exp(-np.pi * damping / np.sqrt(1 - damping**2)) if damping < 1 else 0.0
    assert overshoot == pytest.approx(expected, abs=0.03)


def half_time(lookahead, gain):
    """Time after which half of a step is done [s]."""
    return PERIOD * np.argmax(
        followed(ServoConfig(lookahead_time=lookahead, gain=gain), np.r_[0.0, np.ones(999)]) > 0.5
    )


def test_a_longer_lookahead_and_a_lower_gain_are_later():
    assert half_time(0.03, 2000.0) < half_time(0.1, 2000.0) < half_time(0.2, 2000.0)
    assert half_time(0.1, 2000.0) < half_time(0.1, 300.0) < half_time(0.1, 100.0)


def test_a_longer_lookahead_smoothes_a_shaking_target():
    """At 5 Hz, below the natural frequency of gain 2000 (7 Hz)."""
    shaking = np.sin(2 * np.pi * 5.0 * PERIOD * np.arange(2000))
    left = [
        np.ptp(followed(ServoConfig(lookahead_time=time), shaking)[1000:])
        for time in (0.03, 0.1, 0.2)
    ]
    assert left[0] > 2 * left[1] > 3.5 * left[2]


@pytest.mark.parametrize("periods", [1, 3, 10])
def test_nothing_moves_before_the_transport_is_over(periods):
    step = np.r_[0.0, np.ones(30)]
    moved = np.flatnonzero(followed(ServoConfig(transport=periods * PERIOD), step))
    assert moved[0] == 1 + periods  # the step is sent in period 1


def test_without_lag_a_target_is_reached_one_period_later():
    targets = np.cumsum(np.random.default_rng(0).normal(size=50))
    places = followed(ServoConfig(lag=False), targets)
    np.testing.assert_allclose(places[1:], targets[:-1], atol=1e-12)
    assert ServoConfig(lag=False).servo.lag == PERIOD


def test_a_motion_of_the_controllers_own_ends_where_it_says_and_drops_the_targets_on_their_way():
    servo = ServoJ(ServoConfig(), np.zeros(6))
    for _ in range(5):
        servo.follow(np.full(6, 0.1))
    goal = servo.q_end + 0.002
    servo.go(goal)
    np.testing.assert_allclose(servo.q_end, goal, atol=1e-15)
    servo.go(goal)
    for _ in range(10):
        servo.follow(goal)
    np.testing.assert_allclose(servo.q_end, goal, atol=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"lookahead_time": 0.02}, {"lookahead_time": 0.3}, {"gain": 50.0}, {"gain": 3000.0},
        {"gain": np.nan}, {"transport": 0.0}, {"transport": 0.005}, {"transport": 1.0},
    ],
)  # fmt: skip
def test_what_servoj_does_not_take_is_refused(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        ServoConfig(**values)
