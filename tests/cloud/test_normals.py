import numpy as np
import pytest
from scipy.spatial import KDTree

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


def covariance_planes(points: np.ndarray, near: list) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues, and normals towards the origin, of these neighbourhoods by NumPy."""
    covariances = np.stack([np.cov(points[i].T, bias=True) for i in near])
    values, axes = np.linalg.eigh(covariances)
    normals = axes[..., 0]
    away = np.sum(normals * points, axis=1) > 0
    return values, np.where(away[:, None], -normals, normals)


@pytest.mark.parametrize("how", [{"k": 15}, {"k": 150}, {"radius": 0.05}, {"radius": 0.2}])
def test_normals_and_variations_are_those_of_scipys_neighbours_and_numpys_eigenvectors(how):
    rng = np.random.default_rng(8)
    points = rng.uniform(-0.1, 0.1, (2000, 3)) * [1, 1, 0.1] + [0.05, -0.02, 0.6]
    tree = KDTree(points)
    near = (
        tree.query(points, how["k"])[1]
        if "k" in how
        else tree.query_ball_point(points, how["radius"])
    )
    values, expected = covariance_planes(points, list(near))
    apart = values[:, 1] - values[:, 0] > 1e-3 * values[:, 2]
    assert apart.mean() > 0.98
    normals = estimate_normals(points, **how)
    np.testing.assert_allclose(normals[apart], expected[apart], atol=1e-9)
    np.testing.assert_allclose(
        surface_variation(points, **how), values[:, 0] / values.sum(axis=1), atol=1e-12
    )


def test_two_hundred_thousand_points_in_one_place_have_no_normal():
    points = np.full((200_000, 3), 0.37)
    for how in ({"k": 15}, {"radius": 6e-3}):
        assert np.isnan(estimate_normals(points, **how)).all()
        np.testing.assert_array_equal(surface_variation(points, **how), 0.0)


def test_points_on_a_line_have_no_normal_and_one_beside_them_gives_it():
    line = np.linspace(0, 1, 40)[:, None] * [0.002, 0.001, 0.003] + [0.1, 0.2, 0.5]
    assert np.isnan(estimate_normals(line)).all()
    beside = np.vstack([line, line[20] + [1e-3, 0, 0]])
    expected = np.array([0.0, -3.0, 1.0]) / np.sqrt(10)  # across both, towards the origin
    np.testing.assert_allclose(np.abs(estimate_normals(beside) @ expected), 1.0, atol=1e-12)


def test_a_dense_cloud_has_the_normals_of_a_thin_one():
    """Each of the 50,000 points has all others within the radius."""
    rng = np.random.default_rng(2)
    points = rng.uniform(-1e-3, 1e-3, (50_000, 3)) * [1, 1, 0.1] + [0, 0, 0.5]
    expected = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    normals = estimate_normals(points)
    np.testing.assert_allclose(np.abs(normals @ expected), 1.0, atol=1e-12)


def test_a_surface_seen_edge_on_has_a_normal_of_length_one():
    x, z = np.meshgrid(np.linspace(-0.01, 0.01, 9), np.linspace(0.5, 0.52, 9))
    edge_on = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(np.abs(estimate_normals(edge_on)), np.tile([0.0, 1, 0], (81, 1)))


@pytest.mark.parametrize("call", [estimate_normals, surface_variation])
def test_clouds_that_hold_no_plane_are_refused(call):
    with pytest.raises(ValueError, match="3 points or more, got 0"):
        call(np.empty((0, 3)))
    with pytest.raises(ValueError, match="3 points or more, got 2"):
        call(np.zeros((2, 3)))
    points, _ = sphere_cap(noise=0.0)
    points[5, 2] = np.nan
    with pytest.raises(ValueError, match=r"1 of \d+ points are not, the first is point 5"):
        call(points)


def test_places_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="1 of 1 points are not"):
        estimate_normals(sphere_cap(noise=0.0)[0], at=np.array([[0.0, np.nan, 0.5]]))


@pytest.mark.parametrize("wrong", [{"k": 2}, {"k": 1000}, {"radius": 0.0}, {"radius": np.nan}])
def test_neighbourhoods_that_cannot_define_a_plane_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        estimate_normals(np.zeros((10, 3)), **wrong)
