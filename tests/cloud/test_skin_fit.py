"""Clouds of known shapes, whose truth is a formula, to a skin."""

import numpy as np
import pytest

from breastscan.cloud.skin_fit import fit_cloud
from breastscan.errors import PerceptionError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from sim.tissue.phantom import Phantom, PhantomConfig

PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.0)
SEMI_AXES = np.array([0.065, 0.058, 0.045])


def directions(count: int, seed: int, lowest: float = 0.02) -> np.ndarray:
    u = np.random.default_rng(seed).normal(size=(3 * count, 3))
    u[:, 2] = np.abs(u[:, 2])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u[u[:, 2] > lowest][:count]


def star(radius, count: int = 8000, noise: float = 1e-4, seed: int = 0):
    """Cloud of the surface with this radius over directions u, noise along its normals [m]; the
    normals come from finite differences.
    """
    u = directions(count, seed)
    n = star_normals(radius, u)
    errors = np.random.default_rng(seed + 1).normal(0.0, noise, (len(u), 1))
    return radius(u)[:, None] * u + errors * n, n


def star_normals(radius, u: np.ndarray) -> np.ndarray:
    step = 1e-6
    x = np.cross(u, [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(u, x)

    def point(v: np.ndarray) -> np.ndarray:
        v = v / np.linalg.norm(v, axis=1, keepdims=True)
        return radius(v)[:, None] * v

    along, across = (point(u + step * axis) - point(u - step * axis) for axis in (x, y))
    n = np.cross(along, across)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def ellipsoid(u: np.ndarray) -> np.ndarray:
    return 1.0 / np.linalg.norm(u / SEMI_AXES, axis=1)


def overhanging(u: np.ndarray) -> np.ndarray:
    """A ball of 50 mm whose centre stands 25 mm above the plate: its flank leans outwards by 30
    degrees at the foot.
    """
    c, R = np.array([0.004, 0.0, 0.025]), 0.05
    return u @ c + np.sqrt((u @ c) ** 2 + R**2 - c @ c)


def folded(u: np.ndarray) -> np.ndarray:
    """Two balls that meet in a sharp groove."""
    balls = [(np.array([x, 0.0, 0.0]), R) for x, R in ((0.02, 0.05), (-0.025, 0.045))]
    return np.max([u @ c + np.sqrt((u @ c) ** 2 + R**2 - c @ c) for c, R in balls], axis=0)


def warty(u: np.ndarray) -> np.ndarray:
    at = np.array([0.6, 0.3, 0.74]) / np.linalg.norm([0.6, 0.3, 0.74])
    apart = np.linalg.norm(u - at, axis=1) * 0.055
    return ellipsoid(u) + 0.003 * np.exp(-((apart / 0.005) ** 2))


def errors(skin, radius, count: int = 3000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Off the truth along its normals [m], in standard deviations, and of the normals [deg]."""
    u = directions(count, seed=99, lowest=0.06)
    n = star_normals(radius, u)
    ab = skin.chart(radius(u)[:, None] * u)
    p = skin.points(ab)
    v = p / np.linalg.norm(p, axis=1, keepdims=True)
    off = (np.linalg.norm(p, axis=1) - radius(v)) * np.sum(v * n, axis=1)
    return off, off / skin.sigma(ab), np.degrees(se3.angle_between(skin.normals(ab), n))


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize(
    ("radius", "within_mm", "within_deg"),
    [(ellipsoid, 0.04, 0.4), (overhanging, 0.04, 0.5), (warty, 0.06, 1.0), (folded, 0.2, 2.5)],
)
def test_shapes_are_found_through_noise_of_a_tenth_of_a_millimetre(radius, within_mm, within_deg):
    skin = fit_cloud(*star(radius), PLATE)
    off, _, tilt = errors(skin, radius)
    assert rms(off) * 1e3 < within_mm
    assert tilt.mean() < within_deg


def test_a_wart_of_three_millimetres_stands():
    skin = fit_cloud(*star(warty), PLATE)
    at = np.array([[0.6, 0.3, 0.74]]) / np.linalg.norm([0.6, 0.3, 0.74])
    tip = np.linalg.norm(skin.points(skin.chart(at * warty(at))))
    assert (tip - ellipsoid(at)[0]) * 1e3 == pytest.approx(3.0, abs=0.35)


@pytest.mark.parametrize("radius", [ellipsoid, overhanging])
@pytest.mark.parametrize("noise", [5e-5, 1.5e-4])
def test_errors_are_as_large_as_their_standard_deviation_says(radius, noise):
    clouds = [star(radius, 5000, noise, seed) for seed in (3, 5, 7)]
    z = np.concatenate([errors(fit_cloud(*cloud, PLATE), radius)[1] for cloud in clouds])
    assert 0.8 < rms(z) < 1.25


@pytest.mark.parametrize(("breast", "seed"), [("dense", 21), ("fatty", 22)])
def test_so_are_those_of_a_breast(breast, seed):
    phantom = Phantom(PhantomConfig(breast=breast, seed=seed))
    u = directions(9000, seed)
    p, n = phantom.embed(u), phantom.normal(u)
    noisy = p + np.random.default_rng(seed).normal(0.0, 1e-4, (len(u), 1)) * n
    skin = fit_cloud(noisy, n, PLATE)
    some = u[:, 2] > 0.1
    ab = skin.chart(p[some])
    off = np.sum((skin.points(ab) - p[some]) * n[some], axis=1)
    assert 0.8 < rms(off / skin.sigma(ab)) < 1.25
    assert rms(off) * 1e3 < 0.06


def test_outliers_count_little():
    points, normals = star(ellipsoid)
    wrong = np.random.default_rng(5).choice(len(points), 400, replace=False)
    points[wrong] += 0.005 * normals[wrong]
    off, _, _ = errors(fit_cloud(points, normals, PLATE), ellipsoid)
    assert rms(off) * 1e3 < 0.08


def test_uneven_density_does_not_move_the_skin():
    points, normals = star(ellipsoid, 12000)
    kept = (points[:, 0] < 0) | (np.arange(len(points)) % 4 == 0)
    off, _, _ = errors(fit_cloud(points[kept], normals[kept], PLATE), ellipsoid)
    assert rms(off) * 1e3 < 0.05


def test_a_hole_is_not_known_and_less_sure_and_all_else_is_known():
    points, normals = star(ellipsoid, 12000)
    middle = points[np.argmin(np.linalg.norm(points - [0.03, 0.03, 0.034], axis=1))]
    outside = np.linalg.norm(points - middle, axis=1) > 0.012
    skin = fit_cloud(points[outside], normals[outside], PLATE)
    in_hole = skin.chart(middle[None])
    assert not skin.known(in_hole)[0]
    elsewhere = skin.chart(points[np.linalg.norm(points - middle, axis=1) > 0.02])
    assert skin.known(elsewhere).mean() > 0.995
    assert skin.sigma(in_hole)[0] > 3 * np.median(skin.sigma(elsewhere))


def test_points_that_are_not_finite_are_refused():
    points, normals = star(ellipsoid, 1000)
    points[3, 1] = np.nan
    with pytest.raises(PerceptionError, match="1 of 1000 points"):
        fit_cloud(points, normals, PLATE)


def test_too_few_points_make_no_skin():
    with pytest.raises(PerceptionError, match="100 points of the skin or more, got 50"):
        fit_cloud(*star(ellipsoid, 50), PLATE)
