"""Every law on a spring, whose force is known in closed form, behind a late servo."""

import json
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control import contact
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.force_law import Measurement, Reference
from breastscan.control.laws import LAW_NAMES, Laws
from breastscan.control.phases import PhaseConfig
from breastscan.control.servo_model import ServoModel
from breastscan.errors import ConfigError
from breastscan.run.writing import write_json
from breastscan.servo import Servo

SERVO = Servo(lookahead_time=0.03, gain=2000.0, transport=0.004)
PERIOD, LAG = 0.002, SERVO.lag


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
    memory = ContactMemory.resting(start, SERVO, PERIOD)
    tip = ServoModel.resting(start, SERVO, PERIOD)
    memory = contact.sense(memory, 0.5, config, PERIOD)
    memory, forces = contact.begin(memory, config), []
    for k in range(round(duration / PERIOD)):
        force = stiffness * max(tip.position - surface(k * PERIOD), 0.0)
        memory = contact.sense(memory, force, config, PERIOD)
        memory = contact.regulate(memory, Reference(reference(k * PERIOD)), config, LAG, PERIOD)
        tip = tip.after(memory.depth, lag, PERIOD)
        forces.append(force)
    return np.array(forces)


@pytest.mark.parametrize("law", LAW_NAMES)
@pytest.mark.parametrize("stiffness", [500.0, 1000.0, 2000.0])
def test_every_law_settles_on_the_set_point_without_a_standing_error(law, stiffness):
    assert press(law, stiffness, duration=4.0)[-1] == pytest.approx(5.0, abs=0.02)


@pytest.mark.parametrize("law", LAW_NAMES)
def test_every_law_stays_stable_with_half_more_stiffness_and_a_later_servo(law):
    forces = press(law, 1.5 * 1300.0, lag=0.042, duration=4.0)
    assert np.abs(forces[-250:] - 5.0).max() < 0.05


@pytest.mark.parametrize("law", LAW_NAMES)
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


@pytest.mark.parametrize("law", LAW_NAMES)
@given(force=st.floats(0, 50), rate=st.floats(-0.05, 0.05), depth=st.floats(-0.0299, 0.0299))
def test_one_period_never_passes_the_limits_of_rate_acceleration_and_depth(law, force, rate, depth):
    config = ContactConfig(law=law)
    memory = contact.begin(
        contact.sense(ContactMemory.resting(depth, SERVO, PERIOD), 0.5, config, PERIOD), config
    )
    memory = contact.advance(memory, rate, 1e9, LAG, PERIOD)
    before = contact.sense(memory, force, config, PERIOD)
    after = contact.regulate(before, Reference(5.0), config, LAG, PERIOD)
    assert abs(after.rate) <= config.rate_limit
    assert abs(after.rate - before.rate) <= config.acceleration * PERIOD * (1 + 1e-9)


@pytest.mark.parametrize("law", LAW_NAMES)
@pytest.mark.parametrize("force", [0.0, 14.0])
def test_at_the_bound_of_the_depth_the_tip_comes_to_rest_within_its_acceleration(law, force):
    """Without a force that answers, however long a law wants to go on."""
    config = ContactConfig(law=law, depth_limit=0.01)
    memory = contact.begin(
        contact.sense(ContactMemory.resting(0.0, SERVO, PERIOD), 0.5, config, PERIOD), config
    )
    for _ in range(2000):
        before = contact.sense(memory, force, config, PERIOD)
        memory = contact.regulate(before, Reference(5.0), config, LAG, PERIOD)
        assert abs(memory.depth) < config.depth_limit + 0.1e-3
        assert abs(memory.rate - before.rate) <= config.acceleration * PERIOD * (1 + 1e-9)


@pytest.mark.parametrize("law", LAW_NAMES)
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
    memory = ContactMemory.resting(-0.03, SERVO, PERIOD)
    for _ in range(5):
        memory = contact.advance(memory, 0.01, 0.5, LAG, PERIOD)
    assert memory.rate == pytest.approx(0.005)
    for _ in range(20):
        memory = contact.advance(memory, 0.01, 0.5, LAG, PERIOD)
    assert memory.rate == pytest.approx(0.01)


@pytest.mark.parametrize(("noise", "corner"), [(0.05, 100.0), (0.3, 50.0)])
def test_noise_is_learnt_in_the_air_and_never_taken_for_contact(noise, corner):
    config, rng = ContactConfig(), np.random.default_rng(1)
    memory = ContactMemory.resting(-0.03, SERVO, PERIOD)
    band = 1 - np.exp(-2 * np.pi * corner * PERIOD)
    passed = 0.0
    for _ in range(3000):
        passed += band * (noise * np.sqrt((2 - band) / band) * rng.standard_normal() - passed)
        memory = contact.sense(memory, passed, config, PERIOD)
        assert not contact.touches(memory, config)
    assert 0.5 * noise < memory.noise < 1.1 * noise


def test_contact_ends_at_less_force_than_it_begins():
    config, memory = ContactConfig(), ContactMemory.resting(0.0, SERVO, PERIOD)
    for _ in range(200):
        memory = contact.sense(memory, 0.4, config, PERIOD)
    assert not contact.touches(memory, config)
    assert contact.touches(contact.begin(memory, config), config)


@pytest.mark.parametrize(
    "setting", [{"force": -1.0}, {"rate_limit": 0.0}, {"depth_limit": float("nan")}]
)
def test_a_setting_that_is_not_positive_is_refused_by_name(setting):
    with pytest.raises(ConfigError, match=next(iter(setting))):
        ContactConfig(**setting)


def test_a_contact_threshold_above_the_set_point_is_refused():
    with pytest.raises(ConfigError, match="set-point"):
        ContactConfig(force=0.4)


@pytest.mark.parametrize("law", LAW_NAMES)
def test_where_the_skin_is_not_felt_the_tip_comes_at_it_no_faster_than_at_first(law):
    """The skin springs away: a law that trusted its estimate would follow with all the speed it
    is allowed.
    """
    config = ContactConfig(law=law)
    memory = contact.begin(
        contact.sense(ContactMemory.resting(0.0, SERVO, PERIOD), 0.5, config, PERIOD), config
    )
    rates = []
    for _ in range(500):
        memory = contact.sense(memory, 0.0, config, PERIOD)
        memory = contact.regulate(memory, Reference(5.0), config, LAG, PERIOD)
        rates.append(memory.rate)
    assert max(rates) <= config.phases.approach_speed
    assert rates[-1] > 0.0


@pytest.mark.parametrize("law", LAW_NAMES)
def test_a_body_that_is_approached_slowly_is_pressed_slowly(law):
    slow = ContactConfig(law=law, phases=PhaseConfig(approach_speed=0.003))
    memory = contact.begin(
        contact.sense(ContactMemory.resting(0.0, SERVO, PERIOD), 1.0, slow, PERIOD), slow
    )
    for _ in range(200):
        memory = contact.sense(memory, 1.0, slow, PERIOD)
        memory = contact.regulate(memory, Reference(5.0), slow, LAG, PERIOD)
        assert memory.rate <= 0.012


@dataclass(frozen=True)
class Integrator:
    """A law of a user's own: the integral of the force error, and its sum as memory."""

    gain: float = 0.01
    """Speed per force error [m/s/N]."""

    def begin(self, force: float) -> int:
        return 0

    def speed(
        self, measurement: Measurement, reference: Reference, memory: int
    ) -> tuple[float, int]:
        return self.gain * (reference.force - measurement.force), memory + 1


def test_a_law_of_ones_own_holds_its_force_on_a_spring():
    assert press(Integrator(), 1000.0)[-1] == pytest.approx(5.0, abs=0.02)


def test_a_laws_memory_begins_with_a_contact_and_is_what_it_returned():
    config = ContactConfig(law=Integrator())
    memory = ContactMemory.resting(0.0, SERVO, PERIOD)
    assert memory.law is None
    memory = contact.begin(contact.sense(memory, 0.5, config, PERIOD), config)
    for periods in range(3):
        assert memory.law == periods
        memory = contact.regulate(memory, Reference(5.0), config, LAG, PERIOD)


def test_every_name_has_a_law_and_every_law_a_name():
    named = {ContactConfig(law=name).force_law for name in LAW_NAMES}
    assert named == set(vars(Laws()).values())


def test_a_setting_of_ones_own_law_may_be_negative():
    assert ContactConfig(law=Integrator(gain=-0.01)).force_law == Integrator(gain=-0.01)


def test_a_law_of_ones_own_stands_in_the_settings(tmp_path):
    write_json(tmp_path / "config.json", {"contact": ContactConfig(law=Integrator())})
    written = json.loads((tmp_path / "config.json").read_text())
    assert written["contact"]["law"] == {"gain": 0.01}


class WithoutFields:
    """Has the methods, but nothing that could be written down."""

    begin, speed = Integrator.begin, Integrator.speed


@pytest.mark.parametrize("law", [Integrator, WithoutFields()])
def test_what_is_no_law_or_cannot_be_written_down_is_refused(law):
    with pytest.raises(ConfigError, match=r"contact\.law must be one of observer"):
        ContactConfig(law=law)
