import numpy as np
import pytest

from breastscan.cloud.normals import estimate_normals, surface_variation
from breastscan.geometry.se3 import angle_between

RADIUS_M = 0.0786
CENTRE = np.array([0.05, 0.0, 0.588])


def sphere_cap(noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] and true normals on a cap that faces the camera, on a grid of .8 mm as the
    camera sees it.
    """
    x, y = np.meshgrid(np.arange(-75, 76) * 0.8e-3, np.arange(-75, 76) * 0.8e-3)
    inside = np.hypot(x, y) < 0.06
    x, y = x[inside], y[inside]
    normals = np.stack([x, y, -np.sqrt(RADIUS_M**2 - x**2 - y**2)], axis=-1) / RADIUS_M
    points = CENTRE + RADIUS_M * normals
    points[:, 2] += noise * np.random.default_rng(seed).standard_normal(len(points))
    return points, normals


def degrees_off(normals: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.degrees(angle_between(normals, truth))


def test_normals_of_a_noisy_cap_are_within_one_and_a_half_degrees():
    """.35 mm is the depth noise of plain semi-global matching at 540 mm."""
    points, truth = sphere_cap(noise=0.35e-3)
    assert degrees_off(estimate_normals(points), truth).mean() < 1.5


def test_k_nearest_do_as_well_as_a_radius_of_the_same_size():
    points, truth = sphere_cap(noise=0.35e-3)
    assert degrees_off(estimate_normals(points, k=120), truth).mean() < 1.5


def test_normals_of_an_exact_cap_are_exact_inside_and_point_to_the_camera():
    points, truth = sphere_cap(noise=0.0)
    inside = np.hypot(*(points - CENTRE)[:, :2].T) < 0.045
    normals = estimate_normals(points)
    assert degrees_off(normals, truth)[inside].max() < 0.5
    assert (np.sum(normals * -points, axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_covariance_normals_are_numpys_least_squares_planes():
    rng = np.random.default_rng(3)
    points = rng.normal(0, 1, (200, 3)) * [0.1, 0.1, 0.003] + [0.0, 0.0, 0.6]
    query = np.array([[0.01, 0.02, 0.6]])
    near = points[np.linalg.norm(points - query, axis=1) <= 0.05]
    smallest = np.linalg.svd(near - near.mean(axis=0))[2][2]
    assert (
        degrees_off(
            estimate_normals(points, at=query, radius=0.05)[0], -np.sign(smallest[2]) * smallest
        )
        < 1e-6
    )


def test_lonely_points_have_no_normal():
    points = np.array([[0.0, 0.0, 0.5], [0.001, 0.0, 0.5], [0.0, 0.001, 0.5], [0.2, 0.0, 0.5]])
    known = np.isfinite(estimate_normals(points)).all(axis=1)
    assert known.tolist() == [True, True, True, False]


def test_query_far_from_every_point_has_no_normal():
    points, _ = sphere_cap(noise=0.0)
    assert np.isnan(estimate_normals(points, at=np.array([[1.0, 1.0, 1.0]]))).all()


def test_variation_is_zero_on_a_plane_and_grows_with_curvature():
    x, y = np.meshgrid(np.linspace(-0.02, 0.02, 41), np.linspace(-0.02, 0.02, 41))
    centre = 41 * 20 + 20
    bends = [
        surface_variation(np.stack([x, y, 0.5 + 0.5 * curvature * x**2], axis=-1).reshape(-1, 3))[
            centre
        ]
        for curvature in (0.0, 10.0, 20.0)
    ]
    assert bends[0] < 1e-12
    assert bends[0] < bends[1] < bends[2]


@pytest.mark.parametrize("wrong", [{"k": 2}, {"k": 1000}, {"radius": 0.0}])
def test_neighbourhoods_that_cannot_define_a_plane_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        estimate_normals(np.zeros((10, 3)), **wrong)
