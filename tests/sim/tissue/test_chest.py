"""The chest under the breast, tilted and curved, and the breast that lies on it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import minimize, minimize_scalar

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from sim.tissue.chest import ChestConfig, heights_over
from sim.tissue.compliance import compute_compliance
from sim.tissue.compliance_cache import _key
from sim.tissue.mechanics import build_mechanics
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from tests.sim.tissue.press_poses import REST, loop_pose

CURVATURE = 1 / 0.15


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig(), CURVATURE)


@pytest.fixture(scope="module")
def tissue(phantom) -> SoftTissue:
    return SoftTissue(phantom, compute_compliance(phantom, 150))


def test_a_chests_normal_leans_by_its_tilt_towards_its_azimuth():
    R_BS = ChestConfig(tilt=0.2, azimuth=2.0).R_BS
    expected = [np.sin(0.2) * np.cos(2.0), np.sin(0.2) * np.sin(2.0), np.cos(0.2)]
    np.testing.assert_allclose(R_BS[:, 2], expected, atol=1e-12)
    across_B = np.array([-np.sin(2.0), np.cos(2.0), 0.0])
    np.testing.assert_allclose(R_BS @ across_B, across_B, atol=1e-12)
    np.testing.assert_array_equal(ChestConfig(azimuth=1.0).R_BS, np.eye(3))


@pytest.mark.parametrize(
    "wrong", [{"tilt": -0.1}, {"tilt": 1.0}, {"azimuth": np.inf}, {"radius": 0.05}]
)
def test_a_chest_that_cannot_be_is_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        ChestConfig(**wrong)


def test_heights_over_a_curved_chest_are_distances_to_it():
    """Against a minimiser, above and below; and over a flat one they are z itself."""
    p_S = np.random.default_rng(0).uniform([-0.1, -0.15, -0.05], [0.1, 0.15, 0.08], (60, 3))
    found = heights_over(CURVATURE, p_S)
    for (_, y, z), height in zip(p_S, found, strict=True):

        def distance(t: float, y: float = y, z: float = z) -> float:
            return float(np.hypot(y - t, z + CURVATURE * t**2 / 2))

        nearest = minimize_scalar(distance, bounds=(-0.3, 0.3), options={"xatol": 1e-12}).fun
        side = np.sign(z + CURVATURE * y**2 / 2)
        assert height == pytest.approx(side * nearest, abs=1e-9)
    np.testing.assert_array_equal(heights_over(0.0, p_S), p_S[:, 2])


def test_the_breasts_rim_lies_on_the_curved_chest_and_its_map_inverts(phantom):
    skin = phantom.skin
    mesh = trimesh.Trimesh(skin.vertices_S, skin.triangles, process=False)
    rim = mesh.edges_sorted[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]
    _, y, z = skin.vertices_S[rim].reshape(-1, 3).T
    np.testing.assert_allclose(z, -CURVATURE * y**2 / 2, atol=1e-15)
    assert np.ptp(z) > 0.015
    ball = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    ball = ball[np.linalg.norm(ball, axis=1) <= 1] * [1, 1, 0.5] + [0, 0, 0.25]
    np.testing.assert_allclose(phantom.inverse_map(phantom.embed(ball)), ball, atol=1e-12)


def test_the_breasts_top_is_the_highest_of_its_points_over_the_chest(phantom):
    def depth(xy: np.ndarray) -> float:
        ball = np.append(xy, np.sqrt(1 - xy @ xy))
        return -float(phantom.heights(phantom.embed(ball)))

    best = minimize(depth, np.zeros(2), method="Nelder-Mead", options={"fatol": 1e-12})
    assert phantom.height == pytest.approx(-best.fun, abs=1e-8)
    assert abs(phantom.height - 0.055) < 1e-3


def test_the_half_height_loop_counts_heights_along_the_chests_normal(phantom, tissue):
    """It lies on the skin, at equal distances from the chest, and far from level."""
    loop_S = Truth(phantom, tissue).level_loop(0.5)
    np.testing.assert_allclose(phantom.heights(loop_S), phantom.height / 2, atol=1e-12)
    np.testing.assert_allclose(phantom.level(loop_S), 0.0, atol=1e-12)
    assert np.ptp(loop_S[:, 2]) > 0.008


def test_rays_stop_at_the_curved_chest(phantom, tissue):
    """Skin is met from above only where it is: beside the breast the rays end on the chest."""
    truth = Truth(phantom, tissue)
    origin_S = np.array([0.1, -0.2, 0.4])
    aims_S = np.random.default_rng(1).uniform([-0.1, -0.14, -0.03], [0.1, 0.14, 0.05], (400, 3))
    hits_S = truth.cast(origin_S, aims_S - origin_S)
    hit = np.isfinite(hits_S[:, 0])
    assert 0.2 < hit.mean() < 0.9
    assert np.abs(truth.distance(hits_S[hit])).max() < 1e-8
    assert phantom.heights(hits_S[hit]).min() > 0
    beyond_S = origin_S + np.linspace(0.3, 1.6, 800)[:, None, None] * (aims_S[~hit] - origin_S)
    inside = (phantom.level(beyond_S) < -1e-3) & (phantom.heights(beyond_S) > 0)
    under = np.logical_or.accumulate(phantom.heights(beyond_S) < 0, axis=0)
    assert not (inside & ~under).any()


def test_tissue_on_a_curved_chest_is_clamped_to_it(phantom, tissue):
    """The force is nearly that on a flat chest, also pressed on the side where the foot lies 15 mm
    lower, and the rim does not move.
    """
    flat = Phantom(PhantomConfig())
    on_flat = SoftTissue(flat, compute_compliance(flat, 150))
    for azimuth in (0.0, 1.2, 4.4):
        forces = [
            np.linalg.norm(held.press(loop_pose(shape, azimuth, 0.005), REST).force_S)
            for shape, held in ((phantom, tissue), (flat, on_flat))
        ]
        assert forces[0] == pytest.approx(forces[1], rel=0.15)
        moved_S = tissue.deformed_skin() - phantom.skin.vertices_S
        on_rim = np.abs(phantom.heights(phantom.skin.vertices_S)) < 1e-12
        assert on_rim.sum() > 400
        np.testing.assert_array_equal(moved_S[on_rim], 0.0)


def test_compliances_of_flat_and_curved_chests_are_kept_apart(phantom):
    assert _key(phantom, 60) != _key(Phantom(PhantomConfig()), 60)
    assert _key(phantom, 60) == _key(Phantom(PhantomConfig(), CURVATURE), 60)


def test_a_flex_on_a_curved_chest_is_refused(phantom):
    config = replace(phantom.config, mechanics="flex")
    with pytest.raises(ConfigError, match="flat chest"):
        build_mechanics(Phantom(config, CURVATURE))


def test_a_curved_chest_moves_normals_as_the_shear_does(phantom):
    """Normals turn with the inverse transpose of the shear's derivative."""
    flat = Phantom(PhantomConfig())
    direction = se3.rotate(np.eye(4), flat.inverse_map(flat.level_loop(0.02, 50)))
    n_S, y = flat.normal(direction), flat.embed(direction)[:, 1]
    sheared = n_S + np.column_stack([0 * y, CURVATURE * y * n_S[:, 2], 0 * y])
    sheared /= np.linalg.norm(sheared, axis=1, keepdims=True)
    np.testing.assert_allclose(phantom.normal(direction), sheared, atol=1e-8)
