"""The parameters of a servo."""

import math

import pytest

from breastscan.errors import ConfigError
from breastscan.servo import Servo


def test_the_lag_is_transport_and_look_ahead_whatever_the_gain():
    for gain in (100.0, 2000.0, math.inf):
        assert Servo(lookahead_time=0.03, gain=gain, transport=0.004).lag == 0.034


def test_a_pure_delay_is_at_its_targets_after_its_transport():
    servo = Servo.pure_delay(0.016)
    assert servo.lag == servo.transport == 0.016
    assert servo.gain == math.inf


@pytest.mark.parametrize(
    "wrong",
    [
        {"lookahead_time": -0.01},
        {"lookahead_time": math.inf},
        {"transport": -0.002},
        {"transport": math.nan},
        {"gain": 0.0},
        {"gain": math.nan},
    ],
)
def test_parameters_that_no_servo_has_are_refused(wrong):
    settings = {"lookahead_time": 0.03, "gain": 2000.0, "transport": 0.004} | wrong
    with pytest.raises(ConfigError, match="servo's"):
        Servo(**settings)
