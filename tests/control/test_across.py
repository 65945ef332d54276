"""The reference across the probe axis, on a chest whose rise is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from breastscan.control import across, contact
from breastscan.control.across import AcrossMemory, Pressed
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.phases import Phase, ramp
from breastscan.control.settle_fit import POWER
from breastscan.robot.ur.ur5e import PERIOD, SERVO

CONFIG = ContactConfig()
ALONG = -0.7
"""Half-way up a breast."""
INDENTATION = 0.006
"""Of 5 N [m]."""
SETTLE, LOOP, LIFT = 1.0, 12.0, 0.35


def sine(t, amplitude=0.005, rate=0.25):
    return amplitude * (1.0 - math.cos(2.0 * math.pi * rate * t))


def cos4(t, amplitude=0.005, rate=0.25):
    return 2.0 * amplitude * math.sin(math.pi * rate * t) ** 4


def scan(
    rise, along=ALONG, plan_error=lambda t: 0.0, noise=0.0, indentation=INDENTATION, power=POWER
):
    """Every period's true rise once the servo has followed, and memory: from first contact to
    a second after the lift. 5 N press by `indentation`, other forces by as much times a power of
    the force.
    """
    rng = np.random.default_rng(0)
    depth = rise(0.0) * along + plan_error(0.0) + indentation * 0.1**power
    memory = replace(ContactMemory.resting(depth, SERVO, PERIOD), variance=noise**2)
    memory = contact.begin(
        replace(memory, slow=replace(memory.slow, force=CONFIG.contact_force)), CONFIG
    )
    now, told, phases = AcrossMemory(), [], []
    for k in range(round((SETTLE + LOOP + LIFT + 1.0) / PERIOD)):
        t = k * PERIOD
        phase = (
            Phase.SETTLE if t < SETTLE else Phase.LOOP if t < SETTLE + LOOP
            else Phase.LIFT if t < SETTLE + LOOP + LIFT else Phase.RETREAT
        )  # fmt: skip
        skin = rise(t) * along + plan_error(t)
        force = 5.0 * (max(memory.servo.position - skin, 0.0) / indentation) ** (1 / power)
        if phase is Phase.RETREAT:
            memory = contact.advance(replace(memory, surface=None), -0.03, 1.0, SERVO.lag, PERIOD)
        else:
            measured = force + noise * rng.standard_normal()
            memory = contact.sense(memory, measured, CONFIG, PERIOD)
            end = t - SETTLE - LOOP
            wanted = ramp(t, 0.5, 5.0, 0.35) if end < 0 else ramp(end, 5.0, 0.0, 0.35)
            memory = contact.regulate(memory, wanted, CONFIG, SERVO.lag, PERIOD)
        now = across.update(
            Pressed(
                phase, memory.servo.position, memory.last, memory.surface, along, SERVO.lag, PERIOD
            ),
            now,
        )
        told.append((rise(t + SERVO.lag), now))
        phases.append(phase)
    return np.array([true for true, _ in told]), [m for _, m in told], np.array(phases)


@pytest.mark.parametrize("indentation", [0.004, 0.006, 0.0077])
@pytest.mark.parametrize("breath", [sine, cos4])
@pytest.mark.parametrize("phase", [0.0, 0.9, 1.7, 2.6, 3.3])
def test_the_breath_is_followed_whatever_its_form_and_wherever_it_begins(
    breath, phase, indentation
):
    """The pictures find the chest at the first of them: the rise counts from there."""
    rise, memories, phases = scan(
        lambda t: breath(t + phase) - breath(phase - 3.0), indentation=indentation
    )
    error = np.array([m.rise for m in memories]) - rise
    late = error[phases == Phase.LOOP][round(1.0 / PERIOD) :]
    assert np.sqrt((late**2).mean()) < 0.65e-3


def test_a_plan_that_is_half_a_millimetre_off_is_hardly_taken_for_breath():
    _, memories, _ = scan(
        lambda t: 0.0, plan_error=lambda t: 0.3e-3 + 0.2e-3 * math.sin(2 * math.pi * t / 4.0)
    )
    assert max(abs(m.rise) for m in memories) < 0.4e-3


@pytest.mark.parametrize("indentation", [0.002, 0.006, 0.0097])
def test_what_was_mistaken_before_the_softness_was_known_is_not_followed(indentation):
    """The observer begins with 6.5 mm at 5 N."""
    _, memories, phases = scan(lambda t: 0.0, indentation=indentation)
    loop = np.array([m.rise for m in memories])[phases == Phase.LOOP]
    assert np.abs(loop[round(0.6 / PERIOD) :]).max() < 0.03e-3


def test_the_indentation_is_that_of_the_force_on_this_skin():
    _, memories, phases = scan(sine)
    told = np.array([m.indentation for m in memories])[phases == Phase.LOOP]
    assert told[-1] == pytest.approx(INDENTATION, abs=0.5e-3)
    assert memories[-1].indentation < 0.2e-3


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_it_sets_in_and_ends_smoothly(noise):
    """From first contact over the lift to the air; on a flank of 45 degrees all of it goes
    across.
    """
    _, memories, _ = scan(sine, noise=noise)
    rise = np.array([m.rise for m in memories])
    assert abs(rise[0]) < 1e-8
    assert abs(rise[-1]) < 0.1e-3
    acceleration = np.abs(np.diff(np.concatenate([[0.0, 0.0], rise]), 2)).max() / PERIOD**2
    assert acceleration < 1.2


def test_where_the_skin_is_lost_the_reference_comes_to_rest_and_stays():
    _, memories, _ = scan(sine)
    before = memories[3000]
    lost = Pressed(Phase.SEARCH, 0.0, 0.0, None, ALONG, SERVO.lag, PERIOD)
    told = [before]
    for _ in range(1000):
        told.append(across.update(lost, told[-1]))
    assert told[-1].rise == pytest.approx(told[-100].rise, abs=1e-6)
    assert abs(told[-1].rise - before.rise) < 1e-3
    steps = np.diff([m.rise for m in told])
    assert np.abs(np.diff(steps)).max() / PERIOD**2 < 0.6


def test_a_force_that_fails_for_a_moment_moves_the_reference_smoothly():
    _, memories, _ = scan(sine)
    now, told = memories[3000], [memories[2999].rise, memories[3000].rise]
    surface = contact.begin(
        replace(
            ContactMemory.resting(0.0, SERVO, PERIOD),
            slow=replace(ContactMemory.resting(0.0, SERVO, PERIOD).slow, force=5.0),
        ),
        CONFIG,
    ).surface
    for force in [*[0.0] * 20, *[2.0] * 20, *[9.0] * 20]:
        pressed = Pressed(Phase.LOOP, 0.004, force, surface, ALONG, SERVO.lag, PERIOD)
        now = across.update(pressed, now)
        told.append(now.rise)
    assert np.abs(np.diff(told, 2)).max() / PERIOD**2 < 0.6


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize(("power", "within"), [(POWER, 0.03), (0.54, 0.17), (0.70, 0.17)])
@pytest.mark.parametrize("indentation", [0.003, 0.006, 0.0097])
def test_the_fit_tells_place_from_softness_while_the_chest_rises(indentation, power, within, noise):
    """By what the observer is off, for comparison, docs/control.md says."""
    _, memories, phases = scan(
        lambda t: cos4(t + 0.6), indentation=indentation, noise=noise, power=power
    )
    told = memories[int(np.flatnonzero(phases == Phase.LOOP)[0]) + 1].softness
    assert 5.0**POWER * told == pytest.approx(indentation, rel=within, abs=3e-4)


def test_without_a_chest_nothing_breathes_and_the_indentation_is_known():
    pressed = Pressed(
        Phase.SETTLE, 0.006, 5.0,
        contact.begin(ContactMemory.resting(0.0, SERVO, PERIOD), CONFIG).surface,
        0.0, SERVO.lag, PERIOD,
    )  # fmt: skip
    memory = AcrossMemory()
    for _ in range(500):
        memory = across.update(pressed, memory)
    assert memory.rise == 0.0
    assert memory.indentation == pytest.approx(
        5.0 ** (1 / 1.5) / CONFIG.surface.stiffness, abs=1e-6
    )
