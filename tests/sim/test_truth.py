import cv2
import numpy as np
import pytest
import trimesh

from breastscan.geometry import se3
from sim.cameras.lens import binned, pixel_rays
from sim.tissue.compliance import compute_compliance
from sim.tissue.phantom import Phantom, PhantomConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from tests.sim.tissue.press_poses import REST, loop_pose


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig())


@pytest.fixture(scope="module")
def tissue(phantom) -> SoftTissue:
    return SoftTissue(phantom, compute_compliance(phantom, 150))


@pytest.fixture
def truth(phantom, tissue) -> Truth:
    tissue.reset()
    return Truth(phantom, tissue)


@pytest.fixture(scope="module")
def spots(phantom) -> tuple[np.ndarray, np.ndarray]:
    """Points of the smooth skin away from the mesh's vertices, and the normals there."""
    direction = np.random.default_rng(0).standard_normal((500, 3))
    direction[:, 2] = np.abs(direction[:, 2]) + 0.1
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return phantom.embed(direction), phantom.normal(direction)


def square_on(axis_S: np.ndarray) -> np.ndarray:
    """Rotation of a probe whose axis is this one."""
    z = axis_S / np.linalg.norm(axis_S)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


@pytest.mark.parametrize("offset", [-0.008, -0.001, 0.0, 0.001, 0.03])
def test_distance_of_a_point_raised_off_the_skin_is_how_far_it_was_raised(truth, spots, offset):
    # around it the skin is hollow, and another point may be closer
    clear_of_the_nipple = spots[0][:, 2] < 0.045
    points_S, normals_S = spots[0][clear_of_the_nipple], spots[1][clear_of_the_nipple]
    np.testing.assert_allclose(truth.distance(points_S + offset * normals_S), offset, atol=1e-8)


def test_closest_point_and_normal_are_those_the_point_was_raised_from(truth, spots):
    points_S, normals_S = spots
    closest_S, closest_normals_S = truth.closest(points_S + 0.005 * normals_S)
    np.testing.assert_allclose(closest_S, points_S, atol=1e-7)
    np.testing.assert_allclose(closest_normals_S, normals_S, atol=1e-5)


def test_closest_point_of_a_point_below_the_rim_lies_on_the_rim(truth):
    closest_S, _ = truth.closest(np.array([[0.2, 0.0, -0.01]]))
    assert closest_S[0, 2] == 0.0


def test_cast_rays_stop_at_the_first_skin_they_meet(truth, phantom):
    origin_S = np.array([0.15, -0.1, 0.4])
    aims_S = np.random.default_rng(1).uniform([-0.1, -0.1, 0], [0.1, 0.1, 0.05], (300, 3))
    hits_S = truth.cast(origin_S, aims_S - origin_S)
    hit = np.isfinite(hits_S[:, 0])
    assert 0.3 < hit.mean() < 0.9
    assert np.abs(truth.distance(hits_S[hit])).max() < 1e-8
    fraction = np.linspace(0, 0.999, 400)[:, None, None]
    between_S = origin_S + fraction * (hits_S[hit] - origin_S)
    assert phantom.level(between_S).min() > 0
    beyond_S = origin_S + np.linspace(0.5, 1.6, 800)[:, None, None] * (aims_S[~hit] - origin_S)
    inside = (phantom.level(beyond_S) < -1e-3) & (beyond_S[..., 2] > 0)
    assert not inside.any()


@pytest.fixture(scope="module")
def X_SC() -> np.ndarray:
    """A camera that looks down on the breast."""
    X_SC = np.eye(4)
    X_SC[:3, :3] = np.diag([1.0, -1.0, -1.0])
    X_SC[:3, 3] = [0.02, 0.01, 0.5]
    return X_SC


@pytest.fixture(scope="module")
def rays_C() -> np.ndarray:
    rays = np.random.default_rng(2).uniform(-0.18, 0.18, (2000, 2))
    return np.column_stack([rays, np.ones(len(rays))])


def test_depth_and_normal_of_the_skin_at_rest_are_those_of_the_smooth_surface(truth, X_SC, rays_C):
    depth, normals_S = truth.seen(X_SC, rays_C)
    hits_S = truth.cast(X_SC[:3, 3], se3.rotate(X_SC, rays_C))
    both = np.isfinite(hits_S[:, 0]) & np.isfinite(depth)
    assert np.mean(np.isfinite(hits_S[:, 0]) == np.isfinite(depth)) > 0.998
    assert 0.3 < both.mean() < 0.9
    seen_S = se3.transform(X_SC, depth[both, None] * rays_C[both])
    assert np.abs(truth.distance(seen_S)).max() < 5e-5
    tilt = se3.angle_between(normals_S[both], truth.closest(hits_S[both])[1])
    assert np.degrees(np.quantile(tilt, 0.95)) < 0.5


def test_seen_points_of_pressed_skin_lie_on_its_facets_before_all_others(
    truth, phantom, tissue, X_SC, rays_C
):
    tissue.press(loop_pose(phantom, 1.0, 0.006), REST)
    depth, normals_S = truth.seen(X_SC, rays_C)
    mesh = trimesh.Trimesh(tissue.deformed_skin(), phantom.skin.triangles, process=False)
    hit = np.flatnonzero(np.isfinite(depth))[::20]
    for i in hit:
        along = np.einsum("tc,tc->t", mesh.triangles[:, 0] - X_SC[:3, 3], mesh.face_normals)
        slope = mesh.face_normals @ se3.rotate(X_SC, rays_C[i])
        at_S = X_SC[:3, 3] + (along / slope)[:, None] * se3.rotate(X_SC, rays_C[i])
        weights = trimesh.triangles.points_to_barycentric(mesh.triangles, at_S)
        met = (weights > 0).all(axis=1)
        assert (along / slope)[met].min() == pytest.approx(depth[i], abs=1e-9)
    assert np.isnan(normals_S[np.isnan(depth)]).all()


def test_a_depth_map_has_each_pixels_ray_through_the_lens(truth, phantom, quiet_scene):
    """OpenCV projects the seen points back on their pixels."""
    camera, X_SC = quiet_scene.rig.left, se3.inverse(quiet_scene.X_BS) @ quiet_scene.X_BL
    small = binned(camera, 4)
    depth = truth.depth_map(small, X_SC)
    rows, columns = np.nonzero(np.isfinite(depth))
    assert len(rows) > 1000
    hits_C = depth[rows, columns, None] * pixel_rays(small)[rows * small.width + columns]
    assert np.abs(truth.distance(se3.transform(X_SC, hits_C))).max() < 5e-5
    pixels = cv2.projectPoints(hits_C, np.zeros(3), np.zeros(3), small.K, small.distortion)[0][:, 0]
    np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=1), atol=1e-6)


def test_visible_points_are_those_that_face_a_viewpoint_low_beside_the_dome(truth, spots):
    points_S, normals_S = spots
    centre_S = np.array([0.3, 0.0, 0.03])
    facing = np.einsum("nc,nc->n", normals_S, centre_S - points_S) / np.linalg.norm(
        centre_S - points_S, axis=1
    )
    seen = truth.visible(points_S, centre_S)
    clear_of_the_nipple = points_S[:, 2] < 0.045
    assert seen[(facing > 0.2) & clear_of_the_nipple].all()
    assert not seen[facing < -0.2].any()
    assert truth.visible(points_S, np.array([0.0, 0.0, 0.6])).mean() > 0.95


def test_material_points_of_the_deformed_skin_are_where_they_came_from(truth, phantom, tissue):
    tissue.press(loop_pose(phantom, 1.0, 0.006), REST)
    skin = phantom.skin
    corners = skin.triangles[::40]
    weights = np.array([0.2, 0.3, 0.5])
    now_S = np.einsum("k,nkc->nc", weights, tissue.deformed_skin()[corners])
    before_S = np.einsum("k,nkc->nc", weights, skin.vertices_S[corners])
    assert np.linalg.norm(now_S - before_S, axis=1).max() > 4e-3
    np.testing.assert_allclose(truth.material_point(now_S), before_S, atol=1e-5)


@pytest.mark.parametrize("fraction", [0.5, 0.85])
def test_the_loop_lies_on_the_skin_at_a_fraction_of_its_height(truth, phantom, fraction):
    loop_S = truth.level_loop(fraction)
    np.testing.assert_allclose(loop_S[:, 2], fraction * phantom.height, atol=1e-9)
    assert np.abs(truth.distance(loop_S[::40])).max() < 1e-9
    assert np.linalg.norm(np.roll(loop_S, -1, axis=0) - loop_S, axis=1).max() < 2e-4


def test_a_probe_presses_where_its_axis_meets_the_undeformed_skin(truth, phantom, spots):
    """Tips on known lines through points of the smooth skin, pressed in by up to 9 mm and leaning
    by 12 degrees.
    """
    rng = np.random.default_rng(4)
    points_S, normals_S = spots
    across_S = np.cross(normals_S, rng.standard_normal(normals_S.shape))
    across_S /= np.linalg.norm(across_S, axis=1, keepdims=True)
    leaning_S = -normals_S + np.tan(np.radians(12)) * across_S
    X_SP = np.stack([se3.pose(square_on(axis), np.zeros(3)) for axis in leaning_S])
    X_SP[:, :3, 3] = points_S + rng.uniform(-0.002, 0.009, (len(X_SP), 1)) * X_SP[:, :3, 2]
    clear_of_the_nipple = points_S[:, 2] < 0.045
    place_S, outward_S = truth.pressed_place(X_SP[clear_of_the_nipple])
    np.testing.assert_allclose(place_S, points_S[clear_of_the_nipple], atol=1e-8)
    np.testing.assert_allclose(outward_S, normals_S[clear_of_the_nipple], atol=1e-6)


def test_a_probe_whose_axis_misses_the_breast_presses_the_skin_closest_to_its_tip(truth):
    X_SP = se3.pose(square_on(np.array([1.0, 0.0, 0.0])), np.array([0.0, 0.0, 0.08]))[None]
    place_S, outward_S = truth.pressed_place(X_SP)
    expected_S, expected_normal_S = truth.closest(X_SP[:, :3, 3])
    np.testing.assert_array_equal(place_S, expected_S)
    np.testing.assert_array_equal(outward_S, expected_normal_S)
