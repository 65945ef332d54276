import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from breastscan.geometry import kinematics, se3
from sim.ur5e import JOINTS, add_arm


@pytest.fixture(scope="module")
def arm():
    root = mjcf.RootElement()
    root.compiler.angle = "radian"
    add_arm(root)
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


@pytest.mark.parametrize("seed", range(10))
def test_flange_pose_equals_the_dh_product(arm, seed):
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, 6)
    data = mujoco.MjData(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(arm, data)
    flange = data.body("flange")
    X_BF = se3.pose(flange.xmat.reshape(3, 3), flange.xpos)
    np.testing.assert_allclose(X_BF, kinematics.forward(q), atol=1e-9)


def test_centre_of_mass_follows_the_published_one(arm):
    q = np.array([0.3, -1.2, 1.1, -0.4, 0.8, 0.2])
    data = mujoco.MjData(arm)
    data.qpos[:] = q
    mujoco.mj_kinematics(arm, data)
    mujoco.mj_comPos(arm, data)
    centres_B = [
        se3.transform(X_BD, np.array(joint.centre, float))
        for X_BD, joint in zip(kinematics.link_frames(q)[1:], JOINTS, strict=True)
    ]
    masses = [joint.mass for joint in JOINTS]
    assert sum(masses) == pytest.approx(17.7)
    np.testing.assert_allclose(data.body("base").subtree_com, np.average(centres_B, axis=0, weights=masses), atol=1e-9)


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
