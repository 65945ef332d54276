"""The follower against what it is to follow."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control.follower import Follower, stopping_speed, towards

PERIOD = 0.002


def test_a_steady_motion_is_followed_without_trailing():
    follower = Follower()
    for k in range(2000):
        follower = follower.after(0.01 * k * PERIOD, 0.01, 2.0, PERIOD)
    assert follower.position == pytest.approx(0.01 * 2000 * PERIOD, abs=1e-7)
    assert follower.rate == pytest.approx(0.01)


def test_a_breath_is_followed_within_a_tenth_of_a_millimetre():
    angular, follower, errors = 2 * math.pi * 0.25, Follower(), []
    for k in range(6000):
        rise = 0.005 * math.sin(angular * k * PERIOD)
        speed = 0.005 * angular * math.cos(angular * k * PERIOD)
        follower = follower.after(rise, speed, 2.0, PERIOD)
        errors.append(follower.position - rise)
    assert np.abs(errors[1000:]).max() < 0.1e-3


@given(targets=st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=30))
def test_no_target_however_it_jumps_asks_for_more_than_the_acceleration(targets):
    follower, bound = Follower(), 0.4
    for target in targets:
        for _ in range(20):
            before = follower
            follower = follower.after(target, 0.0, 2.0, PERIOD, bound)
            assert abs(follower.rate - before.rate) <= bound * PERIOD * (1 + 1e-9)
            assert follower.position == before.position + follower.rate * PERIOD


def test_a_speed_goes_to_the_wanted_one_and_no_farther():
    assert towards(0.0, 1.0, 10.0, 0.002) == pytest.approx(0.02)
    assert towards(0.0, -1.0, 10.0, 0.002) == pytest.approx(-0.02)
    assert towards(0.99, 1.0, 10.0, 0.002) == 1.0


def test_from_the_stopping_speed_one_stops_within_the_distance():
    position, speed = 0.0, stopping_speed(0.01, 0.5)
    while speed > 0.0:
        speed -= 0.5 * PERIOD
        position += max(speed, 0.0) * PERIOD
    assert position == pytest.approx(0.01, rel=0.02)
    assert stopping_speed(-1.0, 0.5) == 0.0
