import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import PlanningError
from breastscan.planning.patch import MlsSurface

COEFFICIENTS = np.array([1e-3, 0.1, -0.2, 4.0, 2.0, -5.0])
R_BA = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
P_BA = np.array([0.4, 0.1, 0.2])


def quadratic_height(xy: np.ndarray) -> np.ndarray:
    x, y = xy.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) @ COEFFICIENTS


def quadratic_surface(count: int = 400, noise: float = 0.0) -> MlsSurface:
    """A quadratic in a rotated and shifted frame A, seen in B."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-0.03, 0.03, (count, 2))
    points_A = np.column_stack([xy, quadratic_height(xy) + rng.normal(0.0, noise, count)])
    normals_B = np.tile(R_BA[:, 2], (count, 1))
    return MlsSurface(points_B=points_A @ R_BA.T + P_BA, normals_B=normals_B, radius=0.015)


def test_patch_reproduces_a_quadratic_surface_and_its_normal():
    patch = quadratic_surface().patch(P_BA, R_BA[:, 2])
    height = COEFFICIENTS[0]
    np.testing.assert_allclose(patch.point(np.zeros(2)), P_BA + height * R_BA[:, 2], atol=1e-12)
    normal_A = np.array([-COEFFICIENTS[1], -COEFFICIENTS[2], 1.0])
    np.testing.assert_allclose(
        patch.normal(np.zeros(2)), R_BA @ normal_A / np.linalg.norm(normal_A), atol=1e-10
    )


def test_tangents_are_the_derivatives_of_the_point():
    patch = quadratic_surface().patch(P_BA, R_BA[:, 2])
    xy = np.array([0.004, -0.003])
    step = 1e-6
    for axis, change in enumerate(np.eye(2) * step):
        numeric = (patch.point(xy + change) - patch.point(xy - change)) / (2 * step)
        np.testing.assert_allclose(patch.tangents(xy)[axis], numeric, atol=1e-9)


def test_noise_of_a_third_of_a_millimetre_is_averaged_to_less_than_a_tenth():
    errors = []
    surface = quadratic_surface(noise=3e-4)
    for origin_A in np.random.default_rng(1).uniform(-0.01, 0.01, (30, 2)):
        p_A = np.append(origin_A, quadratic_height(origin_A[None]))
        patch = surface.patch(R_BA @ p_A + P_BA, R_BA[:, 2])
        errors.append(patch.coefficients[0])
    assert np.sqrt(np.mean(np.square(errors))) * 1e3 < 0.1


def test_outliers_are_left_out():
    surface = quadratic_surface(noise=1e-5)
    surface.points_B[::10] += 0.004 * R_BA[:, 2]
    assert surface.patch(P_BA, R_BA[:, 2]).coefficients[0] * 1e3 == pytest.approx(1.0, abs=0.02)


def test_too_few_points_name_the_place():
    with pytest.raises(PlanningError, match=r"only 0 points within 15 mm of \[1000"):
        quadratic_surface().patch(np.array([1.0, 0.0, 0.0]), R_BA[:, 2])


def test_points_that_are_not_finite_are_refused():
    surface = quadratic_surface()
    surface.points_B[3, 1] = np.nan
    with pytest.raises(PlanningError, match="1 of 400 points"):
        MlsSurface(points_B=surface.points_B, normals_B=surface.normals_B, radius=0.015)
