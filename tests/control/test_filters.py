"""The low-pass, against its closed form."""

import numpy as np
import pytest

from breastscan.control.filters import Filtered

PERIOD, CORNER = 0.0005, 5.0
"""Slow against the sampling, as the stated phase asks."""


def response(frequency):
    """Complex gain of the filtered force and of its change at a frequency [Hz], settled."""
    state, time = Filtered(), np.arange(0.0, 4.0, PERIOD)
    force, change = np.empty((2, len(time)))
    for k, t in enumerate(time):
        state = state.after(np.sin(2 * np.pi * frequency * t), CORNER, PERIOD)
        force[k], change[k] = state.force, state.change
    turning = np.exp(-2j * np.pi * frequency * time)
    late = time >= 2.0
    gains = [2j * np.mean(signal[late] * turning[late]) for signal in (force, change)]
    return gains[0], gains[1] / (2j * np.pi * frequency)


@pytest.mark.parametrize("frequency", [1.0, 5.0, 20.0])
def test_the_force_is_filtered_by_first_order_and_its_change_by_two_in_a_row(
    frequency,
):
    force, change = response(frequency)
    first_order = 1 / (1 + 1j * frequency / CORNER)
    assert force == pytest.approx(first_order, abs=0.02)
    assert change == pytest.approx(first_order**2, abs=0.04)
    assert np.angle(force) == pytest.approx(-np.arctan(frequency / CORNER), abs=0.04)


def test_a_steady_force_passes_unchanged():
    state = Filtered()
    for _ in range(20000):
        state = state.after(5.0, CORNER, PERIOD)
    assert state.force == pytest.approx(5.0)
    assert state.change == pytest.approx(0.0, abs=1e-9)
