"""The servo's model along one axis, against the twin's servo of six joints."""

import numpy as np
import pytest

from breastscan.control.servo_model import ServoModel
from sim.arm.servo import ServoConfig, ServoJ

PERIOD = 0.002


def test_it_is_the_twins_servo_at_its_nominal_settings():
    config = ServoConfig()
    servo, model = ServoJ(config, np.zeros(6)), ServoModel.resting(0.0, PERIOD)
    rng = np.random.default_rng(0)
    target = 0.0
    for _ in range(300):
        target += 1e-4 * rng.standard_normal()
        servo.follow(np.full(6, target))
        model = model.after(target, config.nominal_lag, PERIOD)
        assert model.position == pytest.approx(servo.q[0], abs=1e-12)


@pytest.mark.parametrize("period", [0.002, 0.008])
def test_it_trails_a_ramp_by_its_lag(period):
    model = ServoModel.resting(0.0, period)
    for k in range(round(1.0 / period)):
        model = model.after(0.01 * k * period, 0.034, period)
    late = 0.01 * (1.0 - period) - model.position
    assert late / 0.01 == pytest.approx(0.034, abs=1e-6)


def test_a_servo_without_lag_is_at_its_target():
    assert ServoModel.resting(0.0, PERIOD).after(0.01, PERIOD, PERIOD).position == 0.01
