"""The servo's lag, from joints that follow late."""

import numpy as np
import pytest

from breastscan.control.lag import MAX_CORRECTION, LagEstimate

NOMINAL = 0.034


def estimate(lag, period=0.002, duration=4.0, offset=0.0, amplitude=0.2, noise=0.0):
    """After joints that swing slowly, each at its own pace, `lag` [s] behind their targets and
    `offset` [rad] aside.
    """
    rates, rng = np.array([0.3, 0.5, 0.7, 0.4, 0.6, 0.8]), np.random.default_rng(0)

    def target(time):
        return amplitude * np.sin(rates * time)

    known = LagEstimate.resting(np.zeros(6), NOMINAL, period)
    for k in range(1, round(duration / period)):
        q = target(k * period - lag) + offset + noise * rng.standard_normal(6)
        known = known.after(target(k * period), q, period)
    return known.lag


@pytest.mark.parametrize("period", [0.002, 0.008])
@pytest.mark.parametrize("lag", [0.026, 0.034, 0.042])
def test_the_lag_is_found_to_half_a_millisecond(lag, period):
    assert estimate(lag, period, noise=1e-5) == pytest.approx(lag, abs=0.5e-3)


def test_a_standing_deflection_is_not_taken_for_lag():
    assert estimate(NOMINAL, offset=1e-4) == pytest.approx(NOMINAL, abs=1e-3)


def test_an_arm_at_rest_tells_nothing():
    assert estimate(0.042, amplitude=0.0) == NOMINAL


def test_the_correction_is_bounded():
    assert estimate(0.2) == pytest.approx((1 + MAX_CORRECTION) * NOMINAL)
