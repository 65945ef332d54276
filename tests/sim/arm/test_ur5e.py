import json

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from breastscan.geometry import kinematics, se3
from sim.arm.deviations import ArmConfig, true_arm
from sim.arm.ur5e import JOINTS, add_arm, link_pose
from sim.wrist.wrench_sensor import GRAVITY_W
from tests.geometry.dh_frames import dh_frames
from tests.sim.arm.pinocchio_arm import FILE


def compiled(kinematics=None):
    root = mjcf.RootElement()
    root.compiler.angle = "radian"
    root.option.gravity = GRAVITY_W
    add_arm(root, kinematics)
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def flange_poses(model, angles):
    data = mujoco.MjData(model)
    poses = []
    for q in angles:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        flange = data.body("flange")
        poses.append(se3.pose(flange.xmat.reshape(3, 3), flange.xpos))
    return np.array(poses)


@pytest.fixture(scope="module")
def arm():
    return compiled()


@pytest.fixture(scope="module")
def angles():
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))


def test_flange_pose_equals_the_dh_product(arm, angles):
    np.testing.assert_allclose(flange_poses(arm, angles), kinematics.forward(angles), atol=1e-9)


def test_an_arm_that_deviates_from_its_drawing_has_its_flange_where_its_own_dh_parameters_put_it(
    angles,
):
    deviating = true_arm(ArmConfig(kinematics="uncalibrated", seed=3))
    X_BF = flange_poses(compiled(deviating), angles)
    np.testing.assert_allclose(X_BF, deviating.forward(angles), atol=1e-9)
    assert np.linalg.norm((X_BF - kinematics.forward(angles))[:, :3, 3], axis=1).mean() > 0.5e-3


def test_link_frames_follow_one_another_as_dh_frames():
    X = np.eye(4)
    for number in range(1, 7):
        X = X @ link_pose(number)
    np.testing.assert_allclose(X, kinematics.forward(np.zeros(6)), atol=1e-15)


@pytest.fixture(scope="module")
def by_pinocchio():
    rows = json.loads(FILE.read_text(encoding="utf-8"))["samples"]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def relative_error(found, expected):
    return np.abs(np.array(found) - expected).max() / np.abs(expected).max()


def test_mass_matrix_gravity_and_velocity_terms_are_pinocchios(arm, by_pinocchio):
    """The same numbers in both; see `tests.sim.arm.pinocchio_arm`."""
    data = mujoco.MjData(arm)
    mass = []
    gravity = []
    bias = []
    for q, qd in zip(by_pinocchio["q"], by_pinocchio["qd"], strict=True):
        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_forward(arm, data)
        full = np.empty((6, 6))
        mujoco.mj_fullM(arm, data, full)
        mass.append(full)
        gravity.append(data.qfrc_bias.copy())
        data.qvel[:] = qd
        mujoco.mj_forward(arm, data)
        bias.append(data.qfrc_bias.copy())
    assert relative_error(mass, by_pinocchio["mass_matrix"]) < 1e-9
    assert relative_error(gravity, by_pinocchio["gravity"]) < 1e-9
    assert relative_error(bias, by_pinocchio["bias"]) < 1e-9


def test_the_jacobians_of_arm_and_controller_are_pinocchios(arm, by_pinocchio):
    data, of_arm = mujoco.MjData(arm), []
    for q in by_pinocchio["q"]:
        data.qpos[:] = q
        mujoco.mj_forward(arm, data)
        J = np.empty((6, 6))
        mujoco.mj_jacBody(arm, data, J[:3], J[3:], arm.body("flange").id)
        of_arm.append(J)
    assert relative_error(of_arm, by_pinocchio["jacobian"]) < 1e-9
    assert relative_error(kinematics.jacobian(by_pinocchio["q"]), by_pinocchio["jacobian"]) < 1e-9


def test_centre_of_mass_follows_the_published_one(arm):
    q = np.array([0.3, -1.2, 1.1, -0.4, 0.8, 0.2])
    data = mujoco.MjData(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(arm, data)
    mujoco.mj_comPos(arm, data)
    centres_B = [
        se3.transform(X_BD, np.array(joint.centre, float))
        for X_BD, joint in zip(dh_frames(q)[1:], JOINTS, strict=True)
    ]
    masses = [joint.mass for joint in JOINTS]
    assert sum(masses) == pytest.approx(17.7)
    np.testing.assert_allclose(
        data.body("base").subtree_com, np.average(centres_B, axis=0, weights=masses), atol=1e-9
    )


def test_gravity_compensation_holds_every_posture(arm):
    """Without it, the shoulder alone would need 60 N m and sag by 5 mrad."""
    data = mujoco.MjData(arm)
    q = np.array([0.0, -0.3, 0.4, -1.0, 0.7, 0.0])
    data.qpos[:] = q
    data.ctrl[0::2] = q
    mujoco.mj_step(arm, data, 500)
    assert np.abs(data.qpos - q).max() < 1e-6


def test_the_drives_never_exceed_their_torque(arm):
    data = mujoco.MjData(arm)
    data.ctrl[0::2] = 6.0
    mujoco.mj_step(arm, data, 5)
    assert np.all(np.abs(data.qfrc_actuator) <= [joint.torque + 1e-9 for joint in JOINTS])
