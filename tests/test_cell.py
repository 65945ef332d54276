"""A cell on disk: what it holds comes back, and what is none is named."""

import json
from dataclasses import replace

import numpy as np
import pytest

from breastscan.cell import Cell
from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry.hulls import Shape
from breastscan.robot.ur.worker import LinkLimits
from sim.arm.deviations import ArmConfig
from sim.room.cell import cell_of
from sim.scene import HOME_Q, Scene, SceneConfig


@pytest.fixture(scope="module")
def scene():
    return Scene(SceneConfig(arm=ArmConfig(kinematics="calibrated", seed=3), mount_angle=0.6))


@pytest.fixture(scope="module")
def cell(scene):
    return cell_of(scene)


@pytest.fixture
def content(cell, tmp_path):
    cell.save(tmp_path / "cell.json")
    return json.loads((tmp_path / "cell.json").read_text())


def refused(content, tmp_path, why, error=ConfigError):
    (tmp_path / "cell.json").write_text(json.dumps(content))
    with pytest.raises(error, match=why):
        Cell.load(tmp_path / "cell.json")


def test_a_cell_is_read_back_to_the_last_digit(cell, tmp_path):
    cell.save(tmp_path / "first.json")
    Cell.load(tmp_path / "first.json").save(tmp_path / "second.json")
    assert (tmp_path / "first.json").read_text() == (tmp_path / "second.json").read_text()
    np.testing.assert_array_equal(
        Cell.load(tmp_path / "first.json").kinematics.X_joints, cell.kinematics.X_joints
    )


def test_the_twins_cell_says_what_its_scene_is(scene, cell):
    np.testing.assert_array_equal(cell.X_FP, scene.X_FP)
    np.testing.assert_array_equal(cell.kinematics.X_joints, scene.calibration.X_joints)
    assert {shape.name for shape in cell.tool} == {"sensor_hull", "probe_hull"}
    assert {"table_hull", "post_hull"} <= {shape.name for shape in cell.room}
    top = cell.chest.X[2, 3] + cell.chest.size[2]
    assert top == pytest.approx(scene.X_BS[2, 3], abs=1e-9)


def test_the_link_to_a_cells_robot_carries_the_cell(cell):
    link = replace(cell, link=LinkLimits(slack=2.0)).rtde("127.0.0.9")
    assert (link.host, link.payload, link.limits.slack) == ("127.0.0.9", cell.payload, 2.0)
    np.testing.assert_array_equal(link.X_FP, cell.X_FP)
    np.testing.assert_array_equal(link.kinematics.X_joints, cell.kinematics.X_joints)


def test_a_shape_more_in_the_room_is_kept_clear_of(cell):
    p_B = cell.kinematics.forward(HOME_Q)[:3, 3] + [0.0, 0.0, 0.3]
    X = np.eye(4)
    X[:3, 3] = p_B
    ball = Shape(name="ball", kind="sphere", size=(0.05,), X=X)
    fuller = replace(cell, room=(*cell.room, ball))
    assert cell.clearance(HOME_Q[None])[0] > 0
    with_ball = fuller.clearance
    assert with_ball.closest(HOME_Q).distance <= cell.clearance.closest(HOME_Q).distance
    X[:3, 3] -= [0.0, 0.0, 0.3]
    assert fuller.clearance.closest(HOME_Q).of_other == "ball"
    assert fuller.clearance(HOME_Q[None])[0] < 0


def test_an_entry_that_is_missing_or_too_many_is_named(content, tmp_path):
    refused({k: v for k, v in content.items() if k != "payload"}, tmp_path, "payload")
    refused({**content, "colour": "red"}, tmp_path, "nothing else")


def test_numbers_of_another_shape_or_kind_are_named(content, tmp_path):
    refused(
        {**content, "X_FP": [[1.0, 0.0], [0.0, 1.0]]},
        tmp_path,
        r"X_FP should be numbers of the shape \(4 4\)",
    )
    refused(
        {**content, "payload": {**content["payload"], "mass": "heavy"}},
        tmp_path,
        "mass should be a number",
    )
    refused({**content, "chest": {**content["chest"], "kind": "cone"}}, tmp_path, "kind should be")
    refused(
        {**content, "chest": {**content["chest"], "size": [0.1]}}, tmp_path, "3 positive lengths"
    )


@pytest.mark.parametrize("mass", [float("nan"), -3.0, 0.0])
def test_a_mass_that_nothing_has_is_refused(content, tmp_path, mass):
    refused({**content, "payload": {**content["payload"], "mass": mass}}, tmp_path, "mass")


@pytest.mark.parametrize("change", [{"K": np.zeros((3, 3)).tolist()}, {"width": -1}])
def test_a_camera_that_cannot_be_is_refused(content, tmp_path, change):
    rig = {**content["rig"], "left": {**content["rig"]["left"], **change}}
    refused({**content, "rig": rig}, tmp_path, "no camera has", CalibrationError)


def test_cameras_in_one_place_are_refused(content, tmp_path):
    refused(
        {**content, "rig": {**content["rig"], "X_RL": np.eye(4).tolist()}},
        tmp_path, "baseline is below 1 mm", CalibrationError,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["table_hull", "a/b"])
def test_hulls_without_names_of_their_own_are_refused(content, tmp_path, name):
    first, *others = content["tool"]
    refused({**content, "tool": [{**first, "name": name}, *others]}, tmp_path, "names of their own")


def test_a_hull_named_as_one_of_the_arms_is_told(cell):
    with pytest.raises(ConfigError, match="link2_hull0"):
        replace(cell, room=(replace(cell.room[0], name="link2_hull0"),))


def test_a_size_that_is_no_number_is_refused(content, tmp_path):
    first, *others = content["room"]
    refused(
        {**content, "room": [{**first, "size": [float("nan"), 0.1, 0.1]}, *others]},
        tmp_path,
        "size",
    )


def test_a_cell_whose_chest_nobody_knows_is_one(cell, tmp_path):
    replace(cell, chest=None).save(tmp_path / "cell.json")
    loaded = Cell.load(tmp_path / "cell.json")
    assert loaded.chest is None
    assert loaded.clearance(HOME_Q[None])[0] == pytest.approx(cell.clearance(HOME_Q[None])[0])


def test_a_rig_given_beside_the_file_takes_the_place_of_one_without_a_place(
    cell, content, tmp_path
):
    (tmp_path / "cell.json").write_text(
        json.dumps({**content, "rig": {**content["rig"], "X_BL": None}})
    )
    np.testing.assert_array_equal(
        Cell.load(tmp_path / "cell.json", cell.rig).rig.X_BL, cell.rig.X_BL
    )


def test_a_pose_that_is_none_is_refused(content, tmp_path):
    scaled = (np.diag([2.0, 1.0, 1.0, 1.0]) @ np.array(content["X_FP"])).tolist()
    refused({**content, "X_FP": scaled}, tmp_path, "X_FP is not a rigid pose")


def test_a_rig_without_a_place_in_the_base_is_refused(content, tmp_path):
    rig = {**content["rig"], "X_BL": None}
    refused({**content, "rig": rig}, tmp_path, "handeye", CalibrationError)


def test_a_missing_or_damaged_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match="no cell at"):
        Cell.load(tmp_path / "cell.json")
    (tmp_path / "cell.json").write_text("no cell")
    with pytest.raises(ConfigError, match="not a JSON file"):
        Cell.load(tmp_path / "cell.json")
