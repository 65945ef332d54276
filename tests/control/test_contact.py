"""The contact law on an ideal spring, whose answer is known in closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control import contact
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.errors import ConfigError

PERIOD = 0.002


def press_spring(stiffness, config, duration=3.0, set_point=5.0, surface=lambda t: 0.0):
    """Force history [N] of the regulated probe on a spring [N/m] whose rest position moves with time."""
    memory, forces = ContactMemory(depth=0.0), []
    for k in range(round(duration / PERIOD)):
        force = stiffness * max(memory.depth - surface(k * PERIOD), 0.0)
        memory = contact.regulate(memory, force, set_point, config, PERIOD)
        forces.append(force)
    return np.array(forces)


@pytest.mark.parametrize("stiffness", [400.0, 1000.0, 2000.0])
def test_force_settles_on_the_set_point_without_a_standing_error(stiffness):
    forces = press_spring(stiffness, ContactConfig())
    assert forces[-1] == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("stiffness", [400.0, 1000.0])
def test_force_does_not_overshoot_half_a_newton_on_soft_tissue(stiffness):
    assert press_spring(stiffness, ContactConfig()).max() < 5.5


def test_force_follows_a_surface_that_rises_at_five_millimetres_a_second():
    # a law of first order lags a ramp by speed x damping: skin that comes at 5 mm/s x 60 N s/m adds .3 N
    forces = press_spring(1000.0, ContactConfig(), surface=lambda t: -0.005 * min(t, 2.0), duration=2.0)
    assert forces[-1] == pytest.approx(5.0 + 0.3, abs=0.02)


@given(
    force=st.floats(-50, 50),
    depth=st.floats(-0.02, 0.02),
    rate=st.floats(-0.03, 0.03),
    filtered=st.floats(-20, 20),
    set_point=st.floats(0.1, 10),
)
def test_one_period_never_passes_the_limits_of_rate_acceleration_and_depth(force, depth, rate, filtered, set_point):
    config = ContactConfig()
    after = contact.regulate(ContactMemory(depth, rate, filtered), force, set_point, config, PERIOD)
    assert abs(after.depth - depth) <= config.rate_limit * PERIOD * (1 + 1e-9)
    assert abs(after.depth) <= config.depth_limit
    stopped_by_the_bound = abs(after.depth) == config.depth_limit
    assert stopped_by_the_bound or abs(after.rate - rate) <= config.acceleration * PERIOD * (1 + 1e-9)


def test_the_approach_gathers_speed_no_faster_than_its_acceleration():
    config, memory = ContactConfig(acceleration=0.5), ContactMemory(depth=-0.03)
    for _ in range(5):
        memory = contact.advance(memory, 0.0, 0.01, config, PERIOD)
    assert memory.rate == pytest.approx(0.005)
    for _ in range(20):
        memory = contact.advance(memory, 0.0, 0.01, config, PERIOD)
    assert memory.rate == pytest.approx(0.01)


def test_the_filter_passes_a_steady_force_and_halves_the_power_at_its_corner():
    config = ContactConfig(filter_hz=25.0)
    memory, response = ContactMemory(0.0), []
    for k in range(2000):
        memory = contact.advance(memory, np.sin(2 * np.pi * 25.0 * k * PERIOD), 0.0, config, PERIOD)
        response.append(memory.force)
    assert np.max(np.abs(response[1000:])) == pytest.approx(1 / np.sqrt(2), abs=0.03)


def test_the_set_point_ramps_from_first_contact_to_its_full_value():
    config = ContactConfig(force=5.0, contact_force=0.5, ramp_time=0.5)
    assert contact.ramped_set_point(0.0, config) == 0.5
    assert contact.ramped_set_point(0.25, config) == pytest.approx(2.75)
    assert contact.ramped_set_point(2.0, config) == 5.0


@pytest.mark.parametrize("setting", [{"force": -1.0}, {"damping": 0.0}, {"approach_speed": float("nan")}])
def test_a_setting_that_is_not_positive_is_refused_by_name(setting):
    with pytest.raises(ConfigError, match=next(iter(setting))):
        ContactConfig(**setting)


def test_a_contact_threshold_above_the_set_point_is_refused():
    with pytest.raises(ConfigError, match="set-point"):
        ContactConfig(force=0.4)
