"""The tilt correction on a wrench that is computed from the tilt."""

import math
from dataclasses import replace

import numpy as np
import pytest

from breastscan.control import tilt
from breastscan.control.contact import ContactConfig
from breastscan.control.tilt import Drag, TiltConfig, TiltMemory
from breastscan.errors import ConfigError

PERIOD, CONFIG = 0.002, TiltConfig()


def scan(
    about_x=0.0, about_y=0.0, friction=0.1, heading=0.6, duration=8.0, noise=0.0, config=CONFIG
):
    """The correction after a plan that is tilted [rad] was walked; the probe sets out after a
    second at rest.
    """
    memory, rng = TiltMemory(), np.random.default_rng(0)
    for k in range(round(duration / PERIOD)):
        speed = 0.025 * min(max(k * PERIOD - 1.0, 0.0), 1.0)
        vx, vy = speed * math.cos(heading), speed * math.sin(heading)
        left_x, left_y = about_x + memory.rx, about_y + memory.ry
        drag = -friction * 5.0 / math.hypot(speed, 1e-3)
        fx, fy, fz, my = (
            drag * vx - 5.0 * 0.5 * left_y,
            drag * vy - 5.0 * CONFIG.force_gain * left_x,
            -5.0,
            -5.0 * CONFIG.moment_gain * left_y,
        ) + noise * rng.standard_normal(4) * [1.0, 1.0, 1.0, 0.2]
        memory = tilt.update(Drag((fx, fy, fz, my), (vx, vy), noise, PERIOD), memory, config)
    return memory


@pytest.mark.parametrize("axis", ["about_x", "about_y"])
@pytest.mark.parametrize("angle_deg", [-9.0, -6.0, 6.0, 9.0])
def test_a_tilted_plan_is_turned_to_the_normal_but_for_the_dead_band(axis, angle_deg):
    memory = scan(**{axis: math.radians(angle_deg)}, noise=0.05)
    turned = memory.rx if axis == "about_x" else memory.ry
    dead_band = CONFIG.force_dead_band if axis == "about_x" else CONFIG.moment_dead_band
    assert abs(math.radians(angle_deg) + turned) < dead_band + math.radians(0.4)
    other = memory.ry if axis == "about_x" else memory.rx
    assert abs(other) < math.radians(0.5)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("heading", [0.0, 0.6, 1.57, 3.0])
def test_friction_is_learnt_and_not_taken_for_a_tilt(friction, heading):
    memory = scan(friction=friction, heading=heading)
    assert memory.friction(CONFIG) == pytest.approx(friction, abs=0.015)
    assert abs(memory.rx) < math.radians(1.0)
    assert abs(memory.ry) < math.radians(0.1)


def test_the_correction_stays_within_its_bound_and_its_rate():
    memory = scan(about_x=math.radians(30.0))
    assert memory.rx == pytest.approx(-CONFIG.bound, abs=1e-4)
    one = tilt.update(FALLING, TiltMemory(fy=1.0), CONFIG)
    assert abs(one.rx) == pytest.approx(CONFIG.acceleration * PERIOD**2)
    later = one
    for _ in range(200):
        later = tilt.update(FALLING, later, CONFIG)
    assert abs(later.rates[0]) == pytest.approx(CONFIG.rate_limit)


FALLING = Drag((0.0, 4.0, -5.0, 0.0), (0.0, 0.0), 0.0, PERIOD)
"""A probe that is tilted by as much as there is."""


@pytest.mark.parametrize("change", [{"wrench": (0.3, 0.3, -0.5, 0.0)}, {"noise": 0.3}])
def test_without_a_firm_contact_or_a_good_sensor_nothing_is_turned(change):
    now = replace(Drag((0.3, 0.3, -5.0, 0.01), (0.0, 0.0), 0.05, PERIOD), **change)
    before = TiltMemory(rx=0.01)
    assert tilt.update(now, before, CONFIG) == before


def test_where_the_contact_ends_the_probe_stops_turning_within_its_acceleration():
    """A rotation of 3 degrees a second that ends in one period would ask 40 rad/s^2 of a wrist
    joint.
    """
    memories = [TiltMemory()]
    for _ in range(500):
        memories.append(tilt.update(FALLING, memories[-1], CONFIG))
    assert abs(memories[-1].rates[0]) == pytest.approx(CONFIG.rate_limit)
    lifted = replace(FALLING, wrench=(0.0, 0.0, -0.5, 0.0))
    for _ in range(30):
        memories.append(tilt.update(lifted, memories[-1], CONFIG))
    for _ in range(100):
        memories.append(tilt.rest(memories[-1], CONFIG, PERIOD))
    assert memories[-1].rates == (0.0, 0.0)
    assert memories[-1].rx == memories[-2].rx != 0.0
    turned = np.array([(m.rx, m.ry) for m in memories])
    assert np.abs(np.diff(turned, 2, axis=0)).max() <= CONFIG.acceleration * PERIOD**2 * (1 + 1e-6)


def test_a_setting_that_is_not_positive_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"contact\.tilt\.time_constant"):
        ContactConfig(tilt=TiltConfig(time_constant=0.0))
