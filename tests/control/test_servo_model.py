"""The servo's model along one axis, against the twin's servo of six joints."""

import math

import numpy as np
import pytest

from breastscan.control.servo_model import ServoModel
from breastscan.servo import Servo
from sim.arm.servo import ServoConfig, ServoJ

PERIOD = 0.002
NOMINAL = ServoConfig().servo


def largest_error(config, assumed):
    """By how much the model of an `assumed` servo misses that of `config`, along a motion that
    swings by 1 mm as force control does [m].
    """
    servo, model = ServoJ(config, np.zeros(6)), ServoModel.resting(0.0, assumed, PERIOD)
    rng = np.random.default_rng(0)
    errors, target, speed = [], 0.0, 0.0
    for k in range(2000):
        speed += 0.1 * (0.006 * math.sin(2.0 * math.pi * 1.0 * k * PERIOD) - speed)
        target += PERIOD * speed + 1e-6 * rng.standard_normal()
        servo.follow(np.full(6, target))
        model = model.after(target, assumed.lag, PERIOD)
        errors.append(abs(model.position - servo.q[0]))
    return max(errors)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"gain": 300.0},
        {"lookahead_time": 0.1, "gain": 300.0},
        {"transport": 0.014},
        {"transport": 0.002},
        {"lag": False},
    ],
)
def test_it_is_the_twins_servo_at_whatever_settings_the_robot_reports(settings):
    config = ServoConfig(**settings)
    assert largest_error(config, config.servo) < 1e-12


def test_a_model_of_another_gain_misses_the_servo():
    """What the model did when it knew only one gain."""
    assert largest_error(ServoConfig(gain=300.0), NOMINAL) > 50e-6


@pytest.mark.parametrize("period", [0.002, 0.008])
def test_it_trails_a_ramp_by_its_lag(period):
    model = ServoModel.resting(0.0, NOMINAL, period)
    for k in range(round(1.0 / period)):
        model = model.after(0.01 * k * period, 0.034, period)
    late = 0.01 * (1.0 - period) - model.position
    assert late / 0.01 == pytest.approx(0.034, abs=1e-6)


def test_what_the_lag_is_more_counts_as_look_ahead():
    model = ServoModel.resting(0.0, NOMINAL, PERIOD)
    for k in range(500):
        model = model.after(0.01 * k * PERIOD, 0.042, PERIOD)
    assert (0.01 * 499 * PERIOD - model.position) / 0.01 == pytest.approx(0.042, abs=1e-6)


@pytest.mark.parametrize("periods", [0, 1, 4])
def test_a_pure_delay_is_at_its_target_so_many_periods_later(periods):
    servo = Servo.pure_delay(periods * PERIOD)
    model = ServoModel.resting(0.0, servo, PERIOD)
    positions = []
    for k in range(1, 9):
        model = model.after(float(k), servo.lag, PERIOD)
        positions.append(model.position)
    assert positions == [float(max(k - periods, 0)) for k in range(1, 9)]
