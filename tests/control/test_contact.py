"""Every law on a spring, whose answer is known in closed form, behind a late servo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control import contact
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.laws import LAWS, Reference
from breastscan.control.phases import PhaseConfig
from breastscan.control.servo_model import ServoModel
from breastscan.errors import ConfigError

PERIOD, LAG = 0.002, 0.034


def press(
    law,
    stiffness=1000.0,
    duration=3.0,
    lag=LAG,
    surface=lambda t: 0.0,
    reference=lambda t: 5.0,
    **settings,
):
    """Force history [N] of the probe, that begins with .5 N on a spring [N/m] whose rest
    position moves.
    """
    config = ContactConfig(law=law, **settings)
    start = 0.5 / stiffness
    memory, tip = ContactMemory.resting(start, PERIOD), ServoModel.resting(start, PERIOD)
    memory = contact.sense(memory, 0.5, config, PERIOD)
    memory, forces = contact.meet(memory, config), []
    for k in range(round(duration / PERIOD)):
        force = stiffness * max(tip.position - surface(k * PERIOD), 0.0)
        memory = contact.sense(memory, force, config, PERIOD)
        memory = contact.regulate(memory, Reference(reference(k * PERIOD)), config, LAG, PERIOD)
        tip = tip.after(memory.depth, lag, PERIOD)
        forces.append(force)
    return np.array(forces)


@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("stiffness", [500.0, 1000.0, 2000.0])
def test_every_law_settles_on_the_set_point_without_a_standing_error(law, stiffness):
    assert press(law, stiffness, duration=4.0)[-1] == pytest.approx(5.0, abs=0.02)


@pytest.mark.parametrize("law", list(LAWS))
def test_every_law_stays_stable_with_half_more_stiffness_and_a_later_servo(law):
    forces = press(law, 1.5 * 1300.0, lag=0.042, duration=4.0)
    assert np.abs(forces[-250:] - 5.0).max() < 0.05


@pytest.mark.parametrize("law", list(LAWS))
def test_every_law_gives_way_as_eagerly_as_it_presses(law):
    """A step up and one down of half a newton are mirror images, on a spring."""
    up, down = (
        press(law, reference=lambda t, sign=sign: 5.0 + sign * 0.5 * (t > 3.0), duration=4.5)
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(up[1500:] - 5.0, 5.0 - down[1500:], atol=0.08)


def test_the_observer_follows_breathing_several_times_more_closely_than_a_fixed_pd():
    def breathing(t):
        return 0.003 * np.sin(2 * np.pi * 0.25 * t)

    errors = {
        law: np.sqrt(np.mean((press(law, surface=breathing, duration=8.0)[2000:] - 5.0) ** 2))
        for law in ("observer", "pd")
    }
    assert errors["observer"] < 0.1
    assert errors["pd"] > 3 * errors["observer"]


@pytest.mark.parametrize("law", list(LAWS))
@given(force=st.floats(0, 50), rate=st.floats(-0.05, 0.05), depth=st.floats(-0.0299, 0.0299))
def test_one_period_never_passes_the_limits_of_rate_acceleration_and_depth(law, force, rate, depth):
    config = ContactConfig(law=law)
    memory = contact.meet(
        contact.sense(ContactMemory.resting(depth, PERIOD), 0.5, config, PERIOD), config
    )
    memory = contact.advance(memory, rate, 1e9, LAG, PERIOD)
    before = contact.sense(memory, force, config, PERIOD)
    after = contact.regulate(before, Reference(5.0), config, LAG, PERIOD)
    assert abs(after.rate) <= config.rate_limit
    assert abs(after.depth) <= config.depth_limit
    stopped_by_the_bound = abs(after.depth) == config.depth_limit
    assert stopped_by_the_bound or abs(after.rate - before.rate) <= config.acceleration * PERIOD * (
        1 + 1e-9
    )


@pytest.mark.parametrize("law", list(LAWS))
def test_no_law_winds_up_while_a_bound_holds_it(law):
    """Five seconds out of the skin's reach; once it is back, the force is not above that of a
    fresh contact.
    """
    forces = press(
        law, surface=lambda t: 0.028 if t < 5.0 else 0.022, duration=9.0, depth_limit=0.03
    )
    assert forces.max() < 9.0
    assert forces[-1] == pytest.approx(5.0, abs=0.1)


def test_the_approach_gathers_speed_no_faster_than_its_acceleration():
    memory = ContactMemory.resting(-0.03, PERIOD)
    for _ in range(5):
        memory = contact.advance(memory, 0.01, 0.5, LAG, PERIOD)
    assert memory.rate == pytest.approx(0.005)
    for _ in range(20):
        memory = contact.advance(memory, 0.01, 0.5, LAG, PERIOD)
    assert memory.rate == pytest.approx(0.01)


@pytest.mark.parametrize(("noise", "corner"), [(0.05, 100.0), (0.3, 50.0)])
def test_noise_is_learnt_in_the_air_and_never_taken_for_contact(noise, corner):
    config, rng = ContactConfig(), np.random.default_rng(1)
    memory = ContactMemory.resting(-0.03, PERIOD)
    band = 1 - np.exp(-2 * np.pi * corner * PERIOD)
    passed = 0.0
    for _ in range(3000):
        passed += band * (noise * np.sqrt((2 - band) / band) * rng.standard_normal() - passed)
        memory = contact.sense(memory, passed, config, PERIOD)
        assert not contact.touches(memory, config)
    assert 0.5 * noise < memory.noise < 1.1 * noise


def test_contact_ends_at_less_force_than_it_begins():
    config, memory = ContactConfig(), ContactMemory.resting(0.0, PERIOD)
    for _ in range(200):
        memory = contact.sense(memory, 0.4, config, PERIOD)
    assert not contact.touches(memory, config)
    assert contact.touches(contact.meet(memory, config), config)


@pytest.mark.parametrize(
    "setting", [{"force": -1.0}, {"rate_limit": 0.0}, {"depth_limit": float("nan")}]
)
def test_a_setting_that_is_not_positive_is_refused_by_name(setting):
    with pytest.raises(ConfigError, match=next(iter(setting))):
        ContactConfig(**setting)


def test_a_contact_threshold_above_the_set_point_is_refused():
    with pytest.raises(ConfigError, match="set-point"):
        ContactConfig(force=0.4)


@pytest.mark.parametrize("law", list(LAWS))
def test_where_the_skin_is_not_felt_the_tip_comes_at_it_no_faster_than_at_first(law):
    """The skin springs away: a law that believed to know it would follow with all the speed it
    is allowed.
    """
    config = ContactConfig(law=law)
    memory = contact.meet(
        contact.sense(ContactMemory.resting(0.0, PERIOD), 0.5, config, PERIOD), config
    )
    rates = []
    for _ in range(500):
        memory = contact.sense(memory, 0.0, config, PERIOD)
        memory = contact.regulate(memory, Reference(5.0), config, LAG, PERIOD)
        rates.append(memory.rate)
    assert max(rates) <= config.phases.approach_speed
    assert rates[-1] > 0.0


@pytest.mark.parametrize("law", list(LAWS))
def test_a_body_that_is_approached_slowly_is_pressed_slowly(law):
    slow = ContactConfig(law=law, phases=PhaseConfig(approach_speed=0.003))
    memory = contact.meet(
        contact.sense(ContactMemory.resting(0.0, PERIOD), 1.0, slow, PERIOD), slow
    )
    for _ in range(200):
        memory = contact.sense(memory, 1.0, slow, PERIOD)
        memory = contact.regulate(memory, Reference(5.0), slow, LAG, PERIOD)
        assert memory.rate <= 0.012
