from contextlib import closing
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry import se3
from breastscan.vision.camera import StereoRig
from sim.arm.deviations import ArmConfig
from sim.cameras.camera import SimStereoCamera
from sim.room.cell import walled_cell
from sim.room.describe import VISUAL_GROUP
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.wrist.probe import payload, tip_pose
from sim.wrist.wrench_errors import WrenchSensorConfig
from sim.wrist.wrench_sensor import WrenchSensor


@pytest.fixture(scope="module")
def pictures(quiet_scene):
    """The drawn model and its state with the arm parked."""
    model = quiet_scene.pictures
    data = mujoco.MjData(model)
    data.qpos[:] = HOME_Q
    mujoco.mj_forward(model, data)
    return model, data


def hit(pictures, start_B, towards_B):
    """Distance [m] along a ray to the nearest drawn shape other than the skin; -1 for none."""
    groups = np.arange(6) == VISUAL_GROUP
    found = np.zeros(1, np.int32)
    return mujoco.mj_ray(*pictures, start_B, towards_B, groups.astype(np.uint8), 1, -1, found)


def test_the_chest_plate_lies_in_the_plane_z_s_0(quiet_scene, pictures):
    for x, y in ((0.10, 0.0), (-0.12, 0.10), (0.0, -0.15)):
        start_B = se3.transform(quiet_scene.X_BS, np.array([x, y, 0.2]))
        assert hit(pictures, start_B, np.array([0, 0, -1.0])) == pytest.approx(0.2, abs=1e-6)


def test_the_drawn_skin_is_the_phantoms(quiet_scene, pictures):
    _, data = pictures
    skin_B = se3.transform(quiet_scene.X_BS, quiet_scene.phantom.skin.vertices_S)
    np.testing.assert_allclose(data.flexvert_xpos, skin_B, atol=1e-6)


def test_cameras_stand_where_the_rig_says(quiet_scene, pictures):
    """OpenCV's z looks forward, MuJoCo's backward."""
    _, data = pictures
    rig = quiet_scene.rig
    for side, X_BC in (("left", rig.X_BL), ("right", rig.X_BL @ se3.inverse(rig.X_RL))):
        camera = data.camera(side)
        np.testing.assert_allclose(camera.xpos, X_BC[:3, 3], atol=1e-9)
        np.testing.assert_allclose(
            camera.xmat.reshape(3, 3) @ np.diag([1, -1, -1]), X_BC[:3, :3], atol=1e-9
        )


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_parked_arm_hides_nothing_of_the_phantom(quiet_scene, pictures, side):
    _, data = pictures
    eye_B = data.camera(side).xpos
    for point_B in se3.transform(quiet_scene.X_BS, quiet_scene.phantom.skin.vertices_S[::40]):
        sight_B = point_B - eye_B
        distance = hit(pictures, eye_B + 0.01 * sight_B, sight_B / np.linalg.norm(sight_B))
        assert distance == -1 or distance > 0.99 * np.linalg.norm(sight_B) - 1e-4


def test_the_parked_arm_keeps_clear_of_everything(quiet_scene):
    closest = walled_cell(quiet_scene).clearance.closest(HOME_Q)
    assert closest.distance > 0.03, closest


def test_an_arm_in_the_table_is_found(quiet_scene):
    closest = walled_cell(quiet_scene).clearance.closest(np.array([np.pi, 0.3, 0, 0, 0, 0]))
    assert closest.distance < 0
    assert closest.of_other in {"table_hull", "chest_hull"}


@pytest.mark.parametrize("angle", [0.0, np.pi / 4])
def test_the_compiled_tool_has_the_tip_and_payload_that_the_user_enters(quiet_scene, angle):
    model = Scene(SceneConfig(mount_angle=angle)).physics
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    flange = data.body("flange")
    tool = data.body("tool")
    tip = data.site("tip")
    X_BF = se3.pose(flange.xmat.reshape(3, 3), flange.xpos)
    X_BP = se3.pose(tip.xmat.reshape(3, 3), tip.xpos)
    np.testing.assert_allclose(se3.inverse(X_BF) @ X_BP, tip_pose(angle), atol=1e-9)
    centre_F = se3.transform(se3.inverse(X_BF), tool.xipos)
    np.testing.assert_allclose(centre_F, payload(angle).centre_F, atol=1e-9)
    assert model.body("tool").mass[0] == pytest.approx(payload(angle).mass)
    assert model.body_subtreemass[model.body("flange").id] == pytest.approx(0.65)


def test_default_tip_is_200_mm_of_tool_bent_by_45_degrees():
    expected = np.array([0.14 * np.sin(np.pi / 4), 0, 0.06 + 0.14 * np.cos(np.pi / 4)])
    np.testing.assert_allclose(tip_pose(np.pi / 4)[:3, 3], expected, atol=1e-12)


def test_the_skin_of_pictures_is_the_phantoms(quiet_scene):
    model, skin = quiet_scene.pictures, quiet_scene.phantom.skin
    assert model.nflex == 1
    np.testing.assert_array_equal(model.flex_vert, skin.vertices_S)
    np.testing.assert_array_equal(model.flex_elem.reshape(-1, 3), skin.triangles)
    np.testing.assert_allclose(model.flex_texcoord, skin.uv, atol=1e-7)
    assert model.flex_vertbodyid[0] == model.body("phantom").id


def test_physics_knows_no_skin(quiet_scene):
    assert quiet_scene.physics.nflex == 0
    assert quiet_scene.physics.nv == 6


@pytest.mark.parametrize(
    ("p_BS", "why"),
    [
        ((2.0, 0.0, 0.08), "on the table"),
        ((0.5, -0.8, 0.08), "on the table"),
        ((0.1, 0.0, 0.08), "beside robot"),
        ((0.5, 0.0, -0.1), "above the table"),
        ((0.5, 0.0, np.nan), "finite"),
    ],
)
def test_a_phantom_that_cannot_stand_there_is_refused(p_BS, why):
    with pytest.raises(ConfigError, match=why):
        SceneConfig(p_BS=p_BS)


def test_a_phantom_that_the_cameras_do_not_see_is_refused():
    with pytest.raises(ConfigError, match=r"camera sees \d+ % of the breast"):
        Scene(SceneConfig(p_BS=(0.5, 0.0, 0.62)))


def test_an_impossible_mount_angle_is_refused():
    with pytest.raises(ConfigError, match="mount_angle"):
        SceneConfig(mount_angle=3.0)


def test_a_rig_that_was_never_placed_is_refused(tmp_path, quiet_scene):
    rig = quiet_scene.rig
    path = tmp_path / "unplaced.yaml"
    StereoRig(left=rig.left, right=rig.right, X_RL=rig.X_RL).save(path)
    with pytest.raises(CalibrationError, match="X_BL"):
        Scene(SceneConfig(rig=path))


def test_parts_without_a_seed_follow_the_scenes_and_others_keep_their_own():
    config = SceneConfig(wrist=WrenchSensorConfig(seed=7)).seeded(3)
    assert (config.phantom.seed, config.arm.seed, config.camera.seed) == (3, 3, 3)
    assert config.wrist.seed == 7


@pytest.mark.parametrize("part", ["phantom", "arm", "wrist"])
def test_no_seed_of_a_part_is_accepted_and_ignored(part):
    """Each draws something else, and nothing else than its own."""
    plain = SceneConfig(arm=ArmConfig(kinematics="uncalibrated"))
    own = replace(plain, **{part: replace(getattr(plain, part), seed=5)})
    drawn = [drawings(config.seeded(0)) for config in (plain, own)]
    same = {name for name, values in drawn[0].items() if np.array_equal(values, drawn[1][name])}
    assert same == set(drawn[0]) - {part}


def drawings(config):
    """What each part of a scene draws: shape, axes, errors of a sensor."""
    scene = Scene(config)
    sensor = WrenchSensor(config.wrist, payload(config.mount_angle), scene.X_FP)
    return {
        "phantom": scene.phantom.skin.vertices_S,
        "arm": scene.arm.X_joints,
        "wrist": sensor.measure(np.zeros(6), np.eye(3), np.zeros(3), np.zeros(3)),
    }


def test_the_cameras_seed_draws_their_noise(quiet_scene, monkeypatch):
    drawn = []
    for seed in (None, 0, 5):
        cameras = replace(quiet_scene.config.camera, seed=seed)
        monkeypatch.setattr(quiet_scene, "config", replace(quiet_scene.config, camera=cameras))
        with closing(SimStereoCamera(quiet_scene, binning=8)) as camera:
            drawn.append(camera._rng.standard_normal(3))
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])
