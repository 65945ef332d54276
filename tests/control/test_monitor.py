"""The supervisor's check of the measurements."""

from dataclasses import replace

import numpy as np
import pytest

from breastscan.control import monitor
from breastscan.control.monitor import MonitorMemory, Observation
from breastscan.control.safety import SafetyLimits

LIMITS, PERIOD = SafetyLimits(), 0.002


def wrench(**parts):
    values = dict.fromkeys(("fx", "fy", "fz", "tx", "ty", "tz"), 0.0) | parts
    return tuple(values.values())


def observation(k=0, wrench_P=None, depth=0.0, **changed):
    """The k-th period of a robot that works, pressing with 5 N."""
    pressing = wrench(fz=-5.0 - 1e-3 * (k % 7)) if wrench_P is None else wrench_P
    return replace(Observation(k * PERIOD, k, pressing, 5.0, depth, PERIOD), **changed)


def first_fault(observations):
    """Time of the first fault after the beginning [s], and its words."""
    observations = list(observations)
    state = MonitorMemory.beginning(observations[0])
    for k, now in enumerate(observations[1:], start=1):
        fault, state = monitor.check(now, state, LIMITS)
        if fault is not None:
            return k * PERIOD, str(fault)
    return None, ""


def test_a_sensor_that_works_is_left_alone():
    assert first_fault(observation(k) for k in range(500)) == (None, "")


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (wrench(fz=-10.1), "10.1 N is above the limit of 10.0 N"),
        (wrench(fx=11.0, fy=11.0, fz=-5.0), "above the limit"),
        (wrench(fz=-5.0, ty=3.5), "torque 3.50 N m"),
        (wrench(fz=-5.0, tx=np.nan), "not finite"),
        (wrench(fz=-np.inf), "not finite"),
        (wrench(fz=-46.0), "beyond its range"),
        (wrench(fz=-11.5), "jumped from 5.0 to 11.5 N"),
        (wrench(fz=1.5), "jumped from 5.0 to -1.5 N"),
    ],
)
def test_a_bad_wrench_is_told_at_once(bad, why):
    time, words = first_fault([observation(0), observation(1, bad)])
    assert time == PERIOD
    assert why in words


def test_a_jump_on_the_way_down_is_told_as_something_hard_with_its_stiffness():
    """15 mm/s are .03 mm in a period: 6.2 N over them are 207 N/mm."""
    before = observation(0, wrench(fz=0.0), depth=0.0)
    for depth, force, why in (
        (30e-6, 6.2, "as stiff as 207 N/mm, where tissue has about 1"),
        (0.0, 6.2, "no contact does that"),
        (-30e-6, 6.2, "no contact does that"),
        (30e-6, -6.2, "no contact does that"),
    ):
        now = observation(1, wrench(fz=-force), depth=depth)
        assert why in first_fault([before, now])[1]


def test_a_sensor_that_pulls_is_told():
    slowly = [observation(k, wrench(fz=0.1 * k)) for k in range(60)]
    assert "draws the probe in with 5.1 N" in first_fault(slowly)[1]


def test_the_limit_rises_with_the_set_point_but_never_above_the_absolute_one():
    state = MonitorMemory.beginning(observation(0, wrench(fz=-12.0)))
    for set_point, passes in ((5.0, False), (8.0, True), (14.0, True)):
        now = observation(1, wrench(fz=-12.5), set_point=set_point)
        assert (monitor.check(now, state, LIMITS)[0] is None) == passes
    assert (
        monitor.check(observation(1, wrench(fz=-15.1), set_point=14.0), state, LIMITS)[0]
        is not None
    )


def test_a_count_of_samples_that_stands_still_is_a_frozen_sensor():
    time, words = first_fault(observation(k, sample=min(k, 50)) for k in range(200))
    assert "no new sample" in words
    assert time == pytest.approx(50 * PERIOD + LIMITS.frozen_time, abs=2 * PERIOD)


def test_a_sensor_that_repeats_itself_while_the_tip_moves_is_frozen_although_it_counts_on():
    frozen = wrench(fz=-5.0)
    time, words = first_fault(observation(k, frozen, depth=0.01 * k * PERIOD) for k in range(200))
    assert "repeats the same wrench" in words
    assert time == pytest.approx(LIMITS.stuck_time, abs=2 * PERIOD)


def test_a_noiseless_sensor_at_rest_may_repeat_itself():
    assert first_fault(observation(k, wrench(fz=-5.0)) for k in range(500)) == (None, "")


def test_silence_of_the_robot_is_told():
    time, words = first_fault([observation(0)] + [observation(0)] * 40)
    assert "no new state for" in words
    assert time == pytest.approx(LIMITS.silence, abs=2 * PERIOD)


def test_a_deadline_missed_by_twenty_milliseconds_is_told_and_one_by_ten_is_not():
    assert first_fault([observation(0), observation(6, sample=1)])[0] is None
    assert (
        "missed its deadline by 20 ms"
        in first_fault([observation(0), observation(11, sample=1)])[1]
    )
