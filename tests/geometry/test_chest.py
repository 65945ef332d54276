"""A bent chest: distances against a minimiser, and the same from another frame."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from breastscan.geometry.chest import Chest

SADDLE = np.diag([7.0, -1.5, 0.0])
"""Falls away along x, rises along y [1/m]."""


def bowl(bend: np.ndarray) -> Chest:
    return Chest(normal=np.array([0.0, 0, 1]), offset=0.0, middle=np.zeros(3), bend=bend)


def below(chest: Chest, xy: np.ndarray) -> np.ndarray:
    return np.append(xy, -xy @ chest.bend[:2, :2] @ xy / 2)


@pytest.mark.parametrize("bend", [SADDLE, np.diag([6.0, 0, 0]), np.diag([3.0, 3.0, 0])])
def test_heights_are_the_distances_to_the_chest(bend):
    chest = bowl(bend)
    p = np.random.default_rng(0).uniform([-0.1, -0.1, -0.02], [0.1, 0.1, 0.08], (60, 3))
    heights = chest.heights(p)
    for point, height in zip(p, heights, strict=True):
        xy = minimize(
            lambda xy, point=point: np.sum((below(chest, xy) - point) ** 2), point[:2], tol=1e-14
        ).x
        side = np.sign(point[2] - below(chest, point[:2])[2])
        nearest = np.linalg.norm(below(chest, xy) - point)
        assert height == pytest.approx(side * nearest, abs=2e-6)


def test_a_chest_without_bend_is_its_plane():
    normal = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])
    chest = Chest(normal=normal, offset=0.03, middle=0.03 * normal, bend=np.zeros((3, 3)))
    p = np.random.default_rng(1).uniform(-0.2, 0.2, (4, 5, 3))
    np.testing.assert_array_equal(chest.heights(p), p @ normal - 0.03)
    assert chest.is_flat
    assert chest.radius == np.inf


def test_a_chest_is_the_same_from_another_frame():
    chest = bowl(SADDLE)
    R = Rotation.from_euler("xyz", [0.7, -0.4, 2.0]).as_matrix()
    X_AB = se3.pose(R, np.array([0.3, -0.1, 0.5]))
    p = np.random.default_rng(2).uniform(-0.08, 0.08, (50, 3))
    seen = chest.seen_from(X_AB)
    np.testing.assert_allclose(seen.heights(se3.transform(X_AB, p)), chest.heights(p), atol=1e-12)
    np.testing.assert_allclose(seen.normal, R[:, 2], atol=1e-12)
    assert seen.radius == pytest.approx(1 / 7.0)


def test_heights_do_not_depend_on_where_the_middle_is_taken():
    """A sphere's cap, touched in two places: near them the two chests agree."""
    radius = 0.15

    def touched(normal: np.ndarray) -> Chest:
        across = np.eye(3) - np.outer(normal, normal)
        return Chest(normal=normal, offset=radius, middle=radius * normal, bend=across / radius)

    leaning = np.array([0.05, 0.0, 1.0]) / np.linalg.norm([0.05, 0.0, 1.0])
    p = np.random.default_rng(3).uniform([-0.03, -0.03, 0.15], [0.03, 0.03, 0.18], (40, 3))
    straight = touched(np.array([0.0, 0.0, 1.0])).heights(p)
    np.testing.assert_allclose(touched(leaning).heights(p), straight, atol=0.1e-3)
    np.testing.assert_allclose(straight, np.linalg.norm(p, axis=1) - radius, atol=0.1e-3)
