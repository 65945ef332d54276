"""The chest through the points around a foot, against the one that they were drawn on."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.cloud.chest_fit import fit_chest
from breastscan.geometry import se3

FOOT = 0.075
"""Radius of the breast's foot [m]."""


def ring(curvatures: tuple[float, float], noise: float = 0.3e-3, count: int = 6000) -> np.ndarray:
    """Points of a chest around a foot, before it and beyond it [m]."""
    rng = np.random.default_rng(0)
    radius = FOOT * np.sqrt(rng.uniform(1.0, 2.0, count))
    azimuth = rng.uniform(0, 2 * np.pi, count)
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    z = -(curvatures[0] * x**2 + curvatures[1] * y**2) / 2 + noise * rng.standard_normal(count)
    return np.column_stack([x, y, z])


def grid() -> np.ndarray:
    """Where heights over the breast's foot count [m]."""
    x = np.linspace(-0.06, 0.06, 13)
    p = np.stack(np.meshgrid(x, x, [0.0, 0.03]), axis=-1).reshape(-1, 3)
    return p[np.hypot(p[:, 0], p[:, 1]) < 0.065]


def test_points_of_a_plane_give_a_flat_chest():
    chest = fit_chest(ring((0.0, 0.0)), np.array([0.0, 0, 0.002]), np.array([0.02, 0, 1]), 2.5e-3)
    assert chest.is_flat
    np.testing.assert_allclose(chest.heights(grid()), grid()[:, 2], atol=0.03e-3)


@pytest.mark.parametrize("curvatures", [(0.0, 6.7), (2.0, 5.0), (3.0, 3.0)])
def test_a_bent_chest_is_found_from_a_guess_beside_it(curvatures):
    """The guess is off by 6 degrees and 8 mm; the frame is any."""
    X = se3.pose(Rotation.from_euler("xyz", [0.5, 0.3, 1.0]).as_matrix(), np.array([0.1, 0.2, 0.7]))
    guess = se3.transform(X, np.array([0.006, -0.005, 0.002]))
    leaning = se3.rotate(X, np.array([0.08, -0.06, 1.0]))
    chest = fit_chest(se3.transform(X, ring(curvatures)), guess, leaning, 2.5e-3)
    expected = fit_chest(ring(curvatures, noise=0.0), np.zeros(3), np.array([0.0, 0, 1]), 2.5e-3)
    found = chest.heights(se3.transform(X, grid()))
    np.testing.assert_allclose(found, expected.heights(grid()), atol=0.15e-3)
    assert 1 / chest.radius == pytest.approx(max(curvatures), rel=0.03)
    drawn = np.column_stack([grid()[:, :2], -(grid()[:, :2] ** 2 @ curvatures) / 2])
    np.testing.assert_allclose(chest.heights(se3.transform(X, drawn)), 0.0, atol=0.15e-3)


def test_skin_and_an_arm_among_the_points_do_not_count():
    """A quarter of them rises up a flank, a tenth lies far above."""
    p = ring((0.0, 5.0))
    p[:1500, 2] += np.random.default_rng(1).uniform(0.003, 0.03, 1500)
    p[1500:2100, 2] += 0.08
    chest = fit_chest(p, np.zeros(3), np.array([0.0, 0, 1]), 2.5e-3)
    drawn = np.column_stack([grid()[:, :2], -5.0 * grid()[:, 1] ** 2 / 2])
    np.testing.assert_allclose(chest.heights(drawn), 0.0, atol=0.15e-3)
