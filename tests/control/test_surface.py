"""The filter over the skin, on a tissue of its own law and on others."""

import numpy as np
import pytest

from breastscan.control.contact import ContactConfig
from breastscan.control.surface import EXPONENT, Surface, SurfaceConfig
from breastscan.errors import ConfigError

PERIOD, CONFIG = 0.002, SurfaceConfig()


def followed(stiffness, skin=lambda t: 0.0, noise=0.05, duration=4.0, exponent=EXPONENT, seed=0):
    """The filter after a press of 5 mm at 12 mm/s that then waits, by someone who does not look
    at the force.
    """
    rng, surface = np.random.default_rng(seed), None
    for k in range(round(duration / PERIOD)):
        time = k * PERIOD
        depth = min(0.012 * time, 0.005)
        indentation = max(depth - skin(time), 0.0)
        force = (
            5.0 * (stiffness * indentation / 5.0 ** (1 / EXPONENT)) ** exponent
            + noise * rng.standard_normal()
        )
        if surface is None and force > 0.5:
            surface = Surface.met(depth, force, CONFIG.stiffness, CONFIG)
        if surface is not None:
            surface = surface.after(depth, force, noise, CONFIG, PERIOD)
    return surface


@pytest.mark.parametrize("stiffness", [250.0, 450.0, 900.0])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_single_press_tells_soft_from_stiff(stiffness, noise):
    """Skin that might move by itself leaves part of a press unexplained: the estimate goes most
    of the way only.
    """
    surface, begun_with = followed(stiffness, noise=noise), CONFIG.stiffness
    missing = np.log(surface.stiffness / stiffness)
    assert abs(missing) < 0.15 + 0.7 * abs(np.log(begun_with / stiffness))
    assert surface.position == pytest.approx(0.0, abs=1.5e-3 + 4e-3 * abs(missing))


def test_a_noisy_press_does_not_upset_the_estimate():
    assert followed(450.0, noise=0.3).stiffness == pytest.approx(450.0, rel=0.4)


def test_a_rising_skin_is_told_from_a_stiff_one():
    """Breathing at its fastest, 5 mm/s against the probe: a ratio of force to motion would find
    40 % more stiffness.
    """
    surface = followed(450.0, skin=lambda t: -0.005 * t, duration=0.8)
    assert surface.speed == pytest.approx(-0.005, abs=1e-3)
    assert surface.stiffness == pytest.approx(450.0, rel=0.25)


def force_on(surface, depth):
    """The law of the indentation that the filter goes by."""
    return (surface.stiffness * max(depth - surface.position, 0.0)) ** EXPONENT


def test_the_force_it_expects_is_the_one_that_comes_although_the_law_of_the_tissue_is_another():
    surface = followed(450.0, exponent=1.3)
    assert force_on(surface, 0.005) == pytest.approx(
        5.0 * (450.0 * 0.005 / 5.0 ** (2 / 3)) ** 1.3, rel=0.01
    )


def test_slope_and_indentation_belong_to_the_force():
    surface = Surface.met(0.001, 0.5, CONFIG.stiffness, CONFIG)
    depth = surface.position + surface.indentation(4.0)
    assert force_on(surface, depth) == pytest.approx(4.0)
    numeric = (force_on(surface, depth + 1e-7) - force_on(surface, depth - 1e-7)) / 2e-7
    assert surface.slope(4.0) == pytest.approx(numeric, rel=1e-6)


def test_the_covariance_stays_positive():
    ss, sv, sk, vv, vk, kk = followed(450.0, noise=0.05).covariance
    P = np.array([[ss, sv, sk], [sv, vv, vk], [sk, vk, kk]])
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0


def test_in_the_air_nothing_is_learnt():
    met = Surface.met(0.001, 0.5, CONFIG.stiffness, CONFIG)
    later = met.after(met.position - 0.01, 0.0, 0.0, CONFIG, PERIOD)
    assert later.stiffness == met.stiffness
    assert later.position == pytest.approx(met.position)


def test_a_setting_that_is_not_positive_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"contact\.surface\.stiffness_spread"):
        ContactConfig(surface=SurfaceConfig(stiffness_spread=0.0))
