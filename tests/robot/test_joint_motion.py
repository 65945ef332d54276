import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from breastscan.robot.joint_motion import braking, trapezoid

PERIOD = 0.002
ANGLES = arrays(float, 6, elements=st.floats(-1, 1))


@settings(deadline=None, max_examples=40)
@given(ANGLES, ANGLES, st.floats(0.5, 3), st.floats(1, 10))
def test_trapezoid_ends_exactly_and_keeps_speed_and_acceleration(start, end, speed, acceleration):
    path = np.array([start, *trapezoid(start, end, speed, acceleration, PERIOD)])
    velocity = np.diff(path, axis=0) / PERIOD
    np.testing.assert_array_equal(path[-1], end)
    assert np.abs(velocity).max(initial=0) <= speed * (1 + 1e-6)
    assert np.abs(np.diff(velocity, axis=0) / PERIOD).max(initial=0) <= 2 * acceleration * (
        1 + 1e-6
    )


def test_trapezoid_moves_all_joints_on_a_straight_line():
    start, end = np.zeros(6), np.array([1.0, -0.5, 0.2, 0, 0, 0.8])
    path = np.array(list(trapezoid(start, end, 0.5, 2.0, PERIOD)))
    np.testing.assert_allclose(path, np.outer(path[:, 0], end), atol=1e-12)


def test_trapezoid_takes_the_textbook_time():
    """A way of 1 rad at .5 rad/s and 2 rad/s^2 takes 1 / .5 + .5 / 2 s."""
    path = list(trapezoid(np.zeros(6), np.ones(6), 0.5, 2.0, PERIOD))
    assert len(path) * PERIOD == pytest.approx(2.25, abs=PERIOD)


def test_braking_sheds_speed_evenly():
    """From 1 rad/s at 4 rad/s^2 an arm needs .25 s and .125 rad."""
    speed = np.array([1.0, -0.5, 0, 0, 0, 0])
    path = np.array(list(braking(np.zeros(6), speed, 4.0, PERIOD)))
    assert len(path) * PERIOD == pytest.approx(0.25, abs=PERIOD)
    np.testing.assert_allclose(path[-1], 0.125 * speed, atol=2e-3)
    assert np.abs(np.diff(path, 2, axis=0)).max() / PERIOD**2 == pytest.approx(4.0, rel=0.02)
