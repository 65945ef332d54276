"""The fit for the skin's softness, on tips whose indentation is known."""

import numpy as np
import pytest

from breastscan.control.settle_fit import POWER, SettleFit
from breastscan.robot.ur.ur5e import PERIOD

TIMES = np.arange(0.0, 1.0, PERIOD)


def fitted(skin, softness, noise=0.0):
    """The softness, with the force rising from .5 to 5 N over a skin that moves."""
    risen = np.minimum(TIMES / 0.35, 1.0)
    force = 0.5 + 4.5 * risen**2 * (3.0 - 2.0 * risen)
    tip = skin(TIMES) + softness * force**POWER
    measured = force + noise * np.random.default_rng(0).standard_normal(len(force))
    roots = np.maximum(measured, 0.0) ** POWER
    fit = SettleFit.beginning(tip[0], roots[0])
    for place, root in zip(tip[1:], roots[1:], strict=True):
        fit = fit.after(place, root, PERIOD)
    return fit.softness(1.0)


@pytest.mark.parametrize("softness", [0.2e-3, 2e-3, 3.5e-3])
def test_on_skin_that_lies_still_the_softness_is_exact(softness):
    found = fitted(lambda t: 0.003 + 0.0 * t, softness)
    assert found == pytest.approx(softness, rel=1e-6)


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("start", [0.0, 0.7, 1.5, 2.2, 3.1])
def test_breath_is_not_taken_for_softness(start, noise):
    """5 mm and 15 breaths a minute, along an axis at 45 degrees to it: 4 mm in this second."""
    found = fitted(
        lambda t: 0.0035 * np.cos(2 * np.pi * 0.25 * (t + start)), softness=2e-3, noise=noise
    )
    assert 5**POWER * found == pytest.approx(5**POWER * 2e-3, abs=0.35e-3)


def test_a_contact_too_short_for_the_fit_goes_by_the_observer():
    fit = SettleFit.beginning(0.0, 1.0)
    for k in range(round(0.3 / PERIOD)):
        fit = fit.after(0.002 * k * PERIOD, 1.0 + k * PERIOD, PERIOD)
    assert fit.softness(2e-3) == 2e-3


@pytest.mark.parametrize(("tip", "root"), [(0.001, 1.0), (0.0, 3.0), (-0.01, 3.0), (0.1, 3.0)])
def test_a_fit_that_tells_nothing_goes_by_the_observer(tip, root):
    """A force that never rises, and tips that do not go in, or far too deep, while it does."""
    fit = SettleFit.beginning(0.0, 1.0)
    for k in range(round(1.0 / PERIOD)):
        risen = min(k / 200, 1.0)
        fit = fit.after(tip * risen, 1.0 + (root - 1.0) * risen, PERIOD)
    assert fit.softness(2e-3) == 2e-3
