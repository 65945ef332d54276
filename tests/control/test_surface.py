"""The filter over the skin, on a tissue of its own law and on others."""

import numpy as np
import pytest
import scipy.linalg

from breastscan.control.contact import ContactConfig
from breastscan.control.surface import EXPONENT, MIN_FORCE, SkinEstimate, SurfaceConfig
from breastscan.errors import ConfigError

PERIOD, CONFIG = 0.002, SurfaceConfig()


def followed(stiffness, skin=lambda t: 0.0, noise=0.05, duration=4.0, exponent=EXPONENT, seed=0):
    """The filter after a press of 5 mm at 12 mm/s that then waits, whatever the force
    is.
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
            surface = SkinEstimate.at_contact(depth, force, CONFIG.stiffness, CONFIG)
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
    surface = SkinEstimate.at_contact(0.001, 0.5, CONFIG.stiffness, CONFIG)
    depth = surface.position + surface.indentation(4.0)
    assert force_on(surface, depth) == pytest.approx(4.0)
    numeric = (force_on(surface, depth + 1e-7) - force_on(surface, depth - 1e-7)) / 2e-7
    assert surface.slope(4.0) == pytest.approx(numeric, rel=1e-6)


def test_the_covariance_stays_positive():
    P = matrix(followed(450.0, noise=0.05).covariance)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0


class MatrixFilter:
    """The same filter as its equations stand in a textbook, in matrices."""

    def __init__(self, estimate, config, period):
        self.config, self.period = config, period
        self.x = np.array([estimate.position, estimate.speed, estimate.log_stiffness])
        self.P = matrix(estimate.covariance)

    def step(self, depth, force, noise):
        T, q, d = self.period, self.config.process_noise, self.config.stiffness_drift
        F = np.array([[1.0, T, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        G = np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
        Q = scipy.linalg.block_diag(q**2 * G, d**2 * T)
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q
        if max(self.h(self.x, depth), force) < MIN_FORCE:
            return
        H = numeric_gradient(lambda x: self.h(x, depth), self.x)
        S = H @ self.P @ H + max(self.config.noise_factor * noise, self.config.force_noise) ** 2
        K = self.P @ H / S
        self.x = self.x + K * (force - self.h(self.x, depth))
        self.P = (np.eye(3) - np.outer(K, H)) @ self.P

    @staticmethod
    def h(x, depth):
        return (np.exp(x[2]) * max(depth - x[0], 0.0)) ** EXPONENT


def matrix(upper):
    P = np.zeros((3, 3))
    P[np.triu_indices(3)] = upper
    return P + np.triu(P, 1).T


def numeric_gradient(function, x):
    """Central differences, each over a step in proportion to its state."""
    steps = np.diag([1e-7, 1e-7, 1e-5])
    return np.array([(function(x + e) - function(x - e)) / (2 * e.sum()) for e in steps])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_every_step_is_that_of_the_matrix_equations(seed, noise):
    """Random presses between .3 and 12 N, of a skin that wanders; the oracle's Jacobian is by
    differences.
    """
    rng = np.random.default_rng(seed)
    config = SurfaceConfig(process_noise=0.02, stiffness_drift=0.05)
    estimate = SkinEstimate.at_contact(0.002, 0.5, 400.0, config)
    oracle = MatrixFilter(estimate, config, PERIOD)
    depth = 0.002
    for _ in range(300):
        depth = float(np.clip(depth + 2e-4 * rng.standard_normal(), 1.5e-3, 9e-3))
        force = float((420.0 * depth) ** EXPONENT + noise * rng.standard_normal())
        estimate = estimate.after(depth, force, noise, config, PERIOD)
        oracle.step(depth, force, noise)
        state = [estimate.position, estimate.speed, estimate.log_stiffness]
        np.testing.assert_allclose(state, oracle.x, rtol=1e-5, atol=1e-7)
        scale = np.sqrt(np.outer(np.diag(oracle.P), np.diag(oracle.P)))
        np.testing.assert_allclose(matrix(estimate.covariance) / scale, oracle.P / scale, atol=1e-5)


def test_in_the_air_nothing_is_learnt():
    met = SkinEstimate.at_contact(0.001, 0.5, CONFIG.stiffness, CONFIG)
    later = met.after(met.position - 0.01, 0.0, 0.0, CONFIG, PERIOD)
    assert later.stiffness == met.stiffness
    assert later.position == pytest.approx(met.position)


def test_a_setting_that_is_not_positive_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"contact\.surface\.stiffness_spread"):
        ContactConfig(surface=SurfaceConfig(stiffness_spread=0.0))
