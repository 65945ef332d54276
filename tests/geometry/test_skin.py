import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from breastscan.geometry.skin import REACH, direction_slopes, directions
from tests.skins import ellipsoid, skin_of

SEMI_AXES = np.array([0.060, 0.072, 0.055])
RNG = np.random.default_rng(0)
PLACES = RNG.uniform(-1.1, 1.1, (200, 2))
"""Chart coordinates [rad] up to the foot."""


@pytest.fixture(scope="module")
def skin():
    return ellipsoid(SEMI_AXES, np.array([0.5, 0.1, 0.08]))


def true_normals(p: np.ndarray) -> np.ndarray:
    n = (p - [0.5, 0.1, 0.08]) / SEMI_AXES**2
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def test_chart_and_points_are_inverse(skin):
    np.testing.assert_allclose(skin.chart(skin.points(PLACES)), PLACES, atol=1e-12)
    axis = skin.points(np.zeros((1, 2)))
    np.testing.assert_allclose(skin.chart(axis), 0.0, atol=1e-12)


def test_points_and_normals_of_an_ellipsoid_are_its_own(skin):
    p = skin.points(PLACES)
    distance = np.linalg.norm((p - skin.centre) / SEMI_AXES, axis=1) - 1
    assert np.abs(distance).max() * 60 < 1e-3  # mm
    assert np.degrees(se3.angle_between(skin.normals(PLACES), true_normals(p))).max() < 0.02


@pytest.mark.parametrize("start", [0.0, 0.99, 1.01])
def test_rays_first_meet_the_skin_where_it_is_wherever_they_begin(skin, start):
    """From 400 mm over the foot, along lines of sight to the side that they face; begun at the eye,
    closely before the skin and under it.
    """
    eye = skin.centre + np.array([0.02, 0.03, 0.4])
    p = skin.points(PLACES)
    seen = np.sum((eye - p) * true_normals(p), axis=1) > 0.02
    hits = skin.first_hits(eye, p[seen] - eye, np.full(np.count_nonzero(seen), start))
    np.testing.assert_allclose(hits, 1.0, atol=1e-7)


def test_rays_beside_the_skin_meet_none(skin):
    eye = skin.centre + np.array([0.0, 0.0, 0.4])
    rays = np.array([[0.2, 0.0, -0.4], [0.0, 0.0, 1.0]])
    assert np.isnan(skin.first_hits(eye, rays)).all()


def test_tangents_are_the_derivatives_of_the_points(skin):
    step = 1e-6
    for tangent, change in zip(skin.tangents(PLACES), np.eye(2) * step, strict=True):
        numeric = (skin.points(PLACES + change) - skin.points(PLACES - change)) / (2 * step)
        np.testing.assert_allclose(tangent, numeric, atol=1e-8)


@pytest.mark.parametrize("centre", [np.zeros(2), np.array([0.9, -0.6]), np.array([0.02, 0.02])])
def test_slopes_of_the_directions_are_their_derivatives_on_the_axis_too(centre):
    step = 1e-6
    for slope, change in zip(direction_slopes(centre[None]), np.eye(2) * step, strict=True):
        numeric = directions((centre + change)[None]) - directions((centre - change)[None])
        np.testing.assert_allclose(slope, numeric / (2 * step), atol=1e-9)


def test_a_ball_off_the_middle_of_the_foot_is_equally_curved_everywhere():
    """A ball of 80 mm whose centre lies 30 mm below the plate and 10 mm aside."""
    c, R = np.array([0.01, 0.0, -0.03]), 0.08
    ball = skin_of(lambda u: u @ c + np.sqrt((u @ c) ** 2 + R**2 - c @ c))
    np.testing.assert_allclose(ball.curvatures(PLACES), 1 / R, rtol=5e-3)


def test_curvatures_of_an_ellipsoid_at_its_tip_are_the_closed_form():
    a, b, c = SEMI_AXES
    tip = ellipsoid(SEMI_AXES, np.zeros(3)).curvatures(np.zeros((1, 2)))[0]
    np.testing.assert_allclose(tip, [c / a**2, c / b**2], rtol=1e-3)


def test_sigma_is_that_of_the_radius_seen_along_the_normal():
    skin = skin_of(lambda u: np.full(len(u), 0.06), sigma=1e-4)
    # sixteen independent coefficients: at the centre of a cell each counts (1/48, 23/48)^2
    share = 2 * (1 / 48) ** 2 + 2 * (23 / 48) ** 2
    centre = np.full((1, 2), 0.5 * 2 * REACH / 48)
    assert skin.sigma(centre)[0] == pytest.approx(1e-4 * share, rel=1e-6)


def test_the_same_skin_seen_from_another_frame(skin):
    X_BA = se3.pose(Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix(), np.array([0.1, 0.2, 0.3]))
    seen = skin.seen_from(X_BA)
    np.testing.assert_allclose(
        seen.points(PLACES), se3.transform(X_BA, skin.points(PLACES)), atol=1e-12
    )
    np.testing.assert_allclose(
        seen.normals(PLACES), se3.rotate(X_BA, skin.normals(PLACES)), atol=1e-12
    )
    np.testing.assert_allclose(seen.curvatures(PLACES), skin.curvatures(PLACES), rtol=1e-9)


def test_skin_is_known_where_it_was_seen_and_nowhere_else(skin):
    support = np.zeros((10, 10), bool)
    support[7, 2] = True
    half = skin.__class__(
        X_AN=skin.X_AN, radii=skin.radii, covariance=skin.covariance, support=support
    )
    side = 2 * REACH / 10
    inside = np.array([7.5, 2.5]) * side - REACH
    places = np.stack([inside, -inside, inside + side, np.array([9.0, 0.0])])
    assert half.known(places).tolist() == [True, False, False, False]
