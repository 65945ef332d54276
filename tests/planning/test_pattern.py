from dataclasses import replace

import numpy as np
import pytest

from breastscan.cloud.skin_fit import fit_cloud
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import REACH, Skin
from breastscan.planning import pattern
from breastscan.planning.pattern import PatternConfig
from tests.skins import ellipsoid, skin_of

SEMI_AXES = np.array([0.070, 0.080, 0.055])
S_ORIGIN_B = np.array([0.5, 0.0, 0.08])
PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)
SKIN = ellipsoid(SEMI_AXES, S_ORIGIN_B)


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


def seen_only(skin: Skin, keep) -> Skin:
    """The skin, seen only where `keep` of points (n 3) in B says so."""
    count = 120
    side = (np.arange(count) + 0.5) * 2 * REACH / count - REACH
    a, b = (x.ravel() for x in np.meshgrid(side, side, indexing="ij"))
    seen = keep(skin.points(np.column_stack([a, b])))
    return replace(skin, support=seen.reshape(count, count))


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
    return pattern.half_height_loop(SKIN, PLATE, PatternConfig())


def test_the_loop_and_its_normals_are_the_skins_own(path):
    np.testing.assert_allclose(distance_from_skin_mm(path.points_B), 0.0, atol=2e-3)
    assert angle_deg(path.normals_B, true_normals(path.points_B)).max() < 0.05
    np.testing.assert_allclose(PLATE.heights(path.points_B) * 1e3, 27.5, atol=1e-3)


def test_between_its_points_the_curve_stays_on_the_skin_and_its_normals_right(path):
    u = np.linspace(0.0, 1.0, 500)
    assert np.abs(distance_from_skin_mm(path.curve.evaluate(u))).max() < 0.1
    assert angle_deg(path.normals(u), true_normals(path.curve.evaluate(u))).max() < 0.5
    np.testing.assert_allclose(np.linalg.norm(path.normals(u), axis=1), 1.0)


def test_a_probe_that_presses_beside_a_points_place_stands_along_the_normal_there(path):
    higher = pattern.half_height_loop(SKIN, PLATE, PatternConfig(), rise=0.002)
    pressed = pattern.pressed_at(path, SKIN, higher.points_B)
    np.testing.assert_array_equal(pressed.points_B, path.points_B)
    assert angle_deg(pressed.normals_B, true_normals(higher.points_B)).max() < 0.2
    assert angle_deg(pressed.normals_B, path.normals_B).min() > 0.8


def test_on_a_noisy_cloud_the_loop_is_right_within_a_tenth_of_a_millimetre():
    loop = pattern.half_height_loop(fit_cloud(*ellipsoid_cloud(), PLATE), PLATE, PatternConfig())
    assert rms(distance_from_skin_mm(loop.points_B)) < 0.1
    assert rms(angle_deg(loop.normals_B, true_normals(loop.points_B))) < 0.6
    np.testing.assert_allclose(PLATE.heights(loop.points_B) * 1e3, 27.5, atol=0.1)


def test_the_top_is_the_tip_of_a_nipple_that_stands_aside():
    tip = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])

    def radius(u: np.ndarray) -> np.ndarray:
        bump = 0.008 * np.exp(-((np.arccos(np.clip(u @ tip, -1, 1)) / 0.15) ** 2))
        return 1.0 / np.linalg.norm(u / SEMI_AXES, axis=1) + bump

    skin = skin_of(radius, se3.pose(np.eye(3), S_ORIGIN_B))
    fine = skin.points(np.random.default_rng(0).uniform(-0.6, 0.6, (200_000, 2)))
    top = skin.points(pattern.top(skin, PLATE)[None])
    assert PLATE.heights(top)[0] * 1e3 == pytest.approx(PLATE.heights(fine).max() * 1e3, abs=0.01)


def test_points_are_even_and_start_towards_the_robot_counter_clockwise(path):
    chords = np.linalg.norm(np.diff(np.vstack([path.points_B, path.points_B[:1]]), axis=0), axis=1)
    assert len(path.points_B) == 15
    assert np.ptp(chords) / chords.mean() < 0.02
    x, y, _ = (path.points_B - S_ORIGIN_B).T
    assert x[0] < 0
    assert abs(y[0]) < 1e-3
    assert np.all(np.diff(np.unwrap(np.arctan2(y, x))) > 0)


def test_tilted_plate_is_followed():
    tilt = np.radians(10.0)
    R = np.array(
        [[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]]
    )
    tilted = Plane(normal=R[:, 2], offset=float(R[:, 2] @ S_ORIGIN_B))
    X = se3.pose(R, S_ORIGIN_B) @ se3.inverse(se3.pose(np.eye(3), S_ORIGIN_B))
    loop = pattern.half_height_loop(SKIN.seen_from(X), tilted, PatternConfig())
    np.testing.assert_allclose(tilted.heights(loop.points_B) * 1e3, 27.5, atol=1e-3)


def test_a_loop_near_the_top_of_a_leaning_breast_goes_round_the_top():
    lean = np.eye(3)
    lean[0, 2] = 0.5  # the top lies 27 mm aside of the middle of the foot
    inverse = np.linalg.inv(lean)
    skin = skin_of(
        lambda u: 1.0 / np.linalg.norm(u @ inverse.T / SEMI_AXES, axis=1),
        se3.pose(np.eye(3), S_ORIGIN_B),
    )
    loop = pattern.half_height_loop(skin, PLATE, PatternConfig(height_fraction=0.9))
    np.testing.assert_allclose(PLATE.heights(loop.points_B) * 1e3, 49.5, atol=0.01)
    top_B = skin.points(pattern.top(skin, PLATE)[None])[0]
    np.testing.assert_allclose(loop.points_B.mean(axis=0)[:2], top_B[:2], atol=5e-3)


def test_a_side_that_was_not_seen_is_named_and_not_bridged():
    missing = seen_only(SKIN, lambda p: np.abs(np.arctan2(p[:, 1], p[:, 0] - 0.5)) < 2.6)
    expected = r"no skin was seen over 1\d% of the loop at 2[78] mm: 0 to [34]0 degrees, 320 to 360"
    with pytest.raises(PlanningError, match=expected):
        pattern.half_height_loop(missing, PLATE, PatternConfig())


def test_a_hole_on_the_way_is_named_with_its_place_and_one_beside_it_is_none():
    on_loop, above = np.array([0.5, 0.0693, 0.1075]), np.array([0.5, 0.04, 0.128])
    with pytest.raises(PlanningError, match=r"first near \[\d+, 6\d, 10\d\] mm in B"):
        pattern.half_height_loop(
            seen_only(SKIN, lambda p: np.linalg.norm(p - on_loop, axis=1) > 0.008),
            PLATE,
            PatternConfig(),
        )
    pattern.half_height_loop(
        seen_only(SKIN, lambda p: np.linalg.norm(p - above, axis=1) > 0.008), PLATE, PatternConfig()
    )


def test_a_top_that_was_not_seen_is_no_top():
    headless = seen_only(SKIN, lambda p: np.hypot(p[:, 0] - 0.5, p[:, 1]) > 0.09)
    with pytest.raises(PlanningError, match="top of the breast"):
        pattern.half_height_loop(headless, PLATE, PatternConfig())


def test_a_loop_smaller_than_the_smallest_is_refused():
    with pytest.raises(
        PlanningError, match=r"radius of 6\d mm, the smallest to be scanned is 90 mm"
    ):
        pattern.half_height_loop(SKIN, PLATE, PatternConfig(smallest_radius=0.09))


@pytest.mark.parametrize(
    ("name", "value"), [("points", 3), ("height_fraction", 1.0), ("smallest_radius", 0.0)]
)
def test_settings_that_make_no_loop_are_named(name, value):
    with pytest.raises(ConfigError, match=name):
        PatternConfig(**{name: value})
