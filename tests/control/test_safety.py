"""The supervisor's limits on commands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from breastscan.control import safety
from breastscan.control.safety import JointCommand, SafetyLimits, Sent, Workspace
from breastscan.errors import ConfigError

LIMITS, PERIOD = SafetyLimits(), 0.002
WORKSPACE = Workspace(np.full(3, -1.0), np.full(3, 1.0))
STEPS = arrays(float, 6, elements=st.floats(-0.1, 0.1))


def command(q, tip=(0.0, 0.0, 0.0), depth=0.0):
    return JointCommand(np.array(q, float), np.array(tip), depth)


def limit_command(wanted, before=None):
    return safety.limit_command(
        wanted, before or Sent.resting(np.zeros(6)), WORKSPACE, LIMITS, PERIOD
    )


def test_a_command_inside_every_limit_passes_to_the_last_bit():
    q = np.linspace(-1e-5, 1e-5, 6)
    sent = limit_command(command(q))
    assert sent.fault is None
    np.testing.assert_array_equal(sent.q, q)


def test_a_command_that_asks_for_too_much_speed_is_shortened_and_names_the_joint():
    before, q = Sent(np.zeros(6), np.full(6, 0.0019)), np.full(6, 0.0019)
    q[3] = 0.0021  # 1.05 rad/s over 2 ms
    sent = limit_command(command(q), before)
    assert "joint 4" in str(sent.fault)
    assert "1.05 rad/s" in str(sent.fault)
    assert sent.q[3] == pytest.approx(0.002)


def test_a_command_that_is_not_finite_is_replaced_by_the_last_one():
    before = Sent(np.ones(6), np.zeros(6))
    sent = limit_command(command(np.full(6, np.nan)), before)
    assert "not finite" in str(sent.fault)
    np.testing.assert_array_equal(sent.q, np.ones(6))


@given(before=STEPS, wanted=STEPS)
def test_whatever_is_asked_neither_speed_nor_acceleration_pass_their_limits(before, wanted):
    before = np.clip(before, -LIMITS.joint_speed * PERIOD, LIMITS.joint_speed * PERIOD)
    sent = limit_command(command(wanted), Sent(np.zeros(6), before))
    assert np.abs(sent.step).max() <= LIMITS.joint_speed * PERIOD * (1 + 1e-12)
    assert np.abs(sent.step - before).max() <= LIMITS.joint_acceleration * PERIOD**2 * (1 + 1e-9)
    np.testing.assert_allclose(sent.q, sent.step, atol=1e-15)
    assert (sent.fault is None) == np.array_equal(sent.q, wanted)


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        (command(np.zeros(6), tip=(0.0, 1.01, 0.0)), "workspace"),
        (command(np.zeros(6), depth=0.026), "26 mm beyond"),
    ],
)
def test_a_tip_outside_its_workspace_or_too_deep_is_told(wanted, why):
    assert why in str(limit_command(wanted).fault)


@pytest.mark.parametrize(
    ("offset", "why"), [(0.013, None), (-0.0145, "14 mm above"), (0.015, "15 mm below")]
)
def test_skin_that_is_elsewhere_is_told(offset, why):
    fault = safety.check_skin(offset, 0.0, 0.0, LIMITS)
    assert fault is None if why is None else why in str(fault)


@pytest.mark.parametrize(
    ("speed", "duration", "passes"), [(0.02, 1.0, True), (-0.03, 0.09, True), (-0.03, 0.2, False)]
)
def test_skin_that_keeps_moving_fast_is_told(speed, duration, passes):
    overspeed = 0.0
    for _ in range(round(duration / PERIOD)):
        overspeed = safety.overspeed_time(speed, overspeed, LIMITS, PERIOD)
    assert (safety.check_skin(0.0, speed, overspeed, LIMITS) is None) == passes
    assert safety.overspeed_time(0.0, overspeed, LIMITS, PERIOD) == 0.0


def test_limits_must_be_positive():
    with pytest.raises(ConfigError, match=r"safety\.force must be"):
        SafetyLimits(force=0.0)
