import numpy as np
import pytest

from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.plane import Plane
from breastscan.planning import pattern
from breastscan.planning.patch import MlsSurface
from breastscan.planning.pattern import PatternConfig

SEMI_AXES = np.array([0.070, 0.080, 0.055])
S_ORIGIN_B = np.array([0.5, 0.0, 0.08])
PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)


def ellipsoid_cloud(
    count: int = 4000, noise: float = 3e-4, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Upper half of an ellipsoid on the plate, with noise along the normals [m]."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    p_S = direction * SEMI_AXES
    n_B = true_normals(p_S + S_ORIGIN_B)
    return p_S + S_ORIGIN_B + rng.normal(0.0, noise, (count, 1)) * n_B, n_B


def true_normals(p_B: np.ndarray) -> np.ndarray:
    n = (p_B - S_ORIGIN_B) / SEMI_AXES**2
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def distance_from_skin_mm(p_B: np.ndarray) -> np.ndarray:
    """To first order in the distance."""
    p_S = p_B - S_ORIGIN_B
    gradient = 2.0 * p_S / SEMI_AXES**2
    return (np.sum((p_S / SEMI_AXES) ** 2, axis=1) - 1.0) / np.linalg.norm(gradient, axis=1) * 1e3


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def path() -> pattern.Path:
    return pattern.half_height_loop(*ellipsoid_cloud(), PLATE, PatternConfig())


def test_loop_lies_within_a_fifth_of_a_millimetre_of_the_skin_on_a_noisy_cloud(path):
    u = np.linspace(0.0, 1.0, 500)
    assert rms(distance_from_skin_mm(path.points_B)) < 0.15
    assert rms(distance_from_skin_mm(path.curve.evaluate(u))) < 0.2


def test_normals_are_within_a_degree_all_along_the_loop(path):
    u = np.linspace(0.0, 1.0, 500)
    assert rms(angle_deg(path.normals_B, true_normals(path.points_B))) < 1.0
    assert rms(angle_deg(path.normals(u), true_normals(path.curve.evaluate(u)))) < 1.0
    np.testing.assert_allclose(np.linalg.norm(path.normals(u), axis=1), 1.0)


def test_loop_lies_at_half_the_height_of_the_breast(path):
    np.testing.assert_allclose(PLATE.heights(path.points_B) * 1e3, 27.5, atol=0.2)


@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-4])
def test_top_is_the_tip_of_the_nipple_and_noise_does_not_raise_it(noise):
    points_B, normals_B = ellipsoid_cloud(4000, noise)
    distance = np.linalg.norm(points_B[:, :2] - S_ORIGIN_B[:2], axis=1)
    points_B[:, 2] += 0.003 * np.exp(-((distance / 0.008) ** 2))
    surface = MlsSurface(points_B=points_B, normals_B=normals_B, radius=0.016)
    assert pattern.top_height(surface, PLATE) * 1e3 == pytest.approx(58.0, abs=0.3)


def test_points_are_even_and_start_towards_the_robot_counter_clockwise(path):
    chords = np.linalg.norm(np.diff(np.vstack([path.points_B, path.points_B[:1]]), axis=0), axis=1)
    assert len(path.points_B) == 15
    assert np.ptp(chords) / chords.mean() < 0.02
    x, y, _ = (path.points_B - S_ORIGIN_B).T
    assert x[0] < 0
    assert abs(y[0]) < 1e-3
    assert np.all(np.diff(np.unwrap(np.arctan2(y, x))) > 0)


def test_without_noise_the_loop_is_on_the_skin_within_a_fiftieth_of_a_millimetre():
    exact = pattern.half_height_loop(*ellipsoid_cloud(8000, noise=0.0), PLATE, PatternConfig())
    assert np.abs(distance_from_skin_mm(exact.points_B)).max() < 0.02
    assert angle_deg(exact.normals_B, true_normals(exact.points_B)).max() < 0.5


def test_outliers_do_not_bend_the_loop():
    points_B, normals_B = ellipsoid_cloud()
    outliers = np.random.default_rng(1).choice(len(points_B), 100, replace=False)
    points_B[outliers] += 0.005 * normals_B[outliers]
    bent = pattern.half_height_loop(points_B, normals_B, PLATE, PatternConfig())
    assert rms(distance_from_skin_mm(bent.points_B)) < 0.2


def test_uneven_density_does_not_move_the_loop():
    points_B, normals_B = ellipsoid_cloud(8000)
    kept = (points_B[:, 0] < 0.5) | (np.arange(8000) % 4 == 0)
    loop = pattern.half_height_loop(points_B[kept], normals_B[kept], PLATE, PatternConfig())
    assert rms(distance_from_skin_mm(loop.points_B)) < 0.2
    np.testing.assert_allclose(loop.points_B.mean(axis=0)[:2], S_ORIGIN_B[:2], atol=5e-4)


def test_tilted_plate_is_followed():
    tilt = np.radians(10.0)
    R = np.array(
        [[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]]
    )
    points_B, normals_B = ellipsoid_cloud()
    tilted = Plane(normal=R[:, 2], offset=float(R[:, 2] @ S_ORIGIN_B))
    rotated_B = (points_B - S_ORIGIN_B) @ R.T + S_ORIGIN_B
    loop = pattern.half_height_loop(rotated_B, normals_B @ R.T, tilted, PatternConfig())
    np.testing.assert_allclose(tilted.heights(loop.points_B) * 1e3, 27.5, atol=0.2)
    assert rms(distance_from_skin_mm((loop.points_B - S_ORIGIN_B) @ R + S_ORIGIN_B)) < 0.15


def test_a_loop_with_a_missing_side_does_not_close():
    points_B, normals_B = ellipsoid_cloud()
    azimuth = np.arctan2(points_B[:, 1], points_B[:, 0] - 0.5)
    seen = np.abs(azimuth) < np.radians(150.0)
    with pytest.raises(PlanningError, match="no skin was seen over 6"):
        pattern.half_height_loop(points_B[seen], normals_B[seen], PLATE, PatternConfig())


def test_a_hole_on_the_way_is_named():
    points_B, normals_B = ellipsoid_cloud()
    hole = np.linalg.norm(points_B - [0.5, 0.0693, 0.1075], axis=1) < 0.017
    with pytest.raises(PlanningError, match="hole in the cloud"):
        pattern.half_height_loop(points_B[~hole], normals_B[~hole], PLATE, PatternConfig())


def test_a_loop_at_the_very_top_is_refused():
    points_B, normals_B = ellipsoid_cloud()
    with pytest.raises(PlanningError, match="lower than the top"):
        pattern.half_height_loop(points_B, normals_B, PLATE, PatternConfig(height_fraction=0.99))


def test_a_loop_smaller_than_the_smallest_is_refused():
    with pytest.raises(
        PlanningError, match=r"radius of 6\d mm, the smallest to be scanned is 90 mm"
    ):
        pattern.half_height_loop(*ellipsoid_cloud(), PLATE, PatternConfig(smallest_radius=0.09))


def test_an_empty_band_is_refused():
    points_B, normals_B = ellipsoid_cloud()
    low = PLATE.heights(points_B) < 0.003
    high = PLATE.heights(points_B) > 0.05
    with pytest.raises(PlanningError, match="points lie near the height"):
        pattern.half_height_loop(
            points_B[low | high], normals_B[low | high], PLATE, PatternConfig()
        )


@pytest.mark.parametrize(
    ("name", "value"),
    [("points", 3), ("height_fraction", 1.0), ("patch_radius", 0.0), ("largest_gap", -1.0)],
)
def test_settings_that_make_no_loop_are_named(name, value):
    with pytest.raises(ConfigError, match=name):
        PatternConfig(**{name: value})
