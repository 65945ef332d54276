"""The inverse kinematics against the model that is simulated, and against a search from
anywhere.
"""

import mujoco
import numpy as np
import pytest

from breastscan.geometry import kinematics
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from sim.arm.ur5e import joint_names


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    return kinematics.forward(np.random.default_rng(4).uniform(-np.pi, np.pi, (300, 6)))


def test_every_solution_puts_the_simulated_flange_there_within_a_nanometre(quiet_scene, poses):
    model = quiet_scene.physics
    data = mujoco.MjData(model)
    joints = [model.joint(name).qposadr[0] for name in joint_names()]
    for X_BF in poses:
        for q in kinematics.inverse(X_BF):
            data.qpos[joints] = q
            mujoco.mj_kinematics(model, data)
            np.testing.assert_allclose(data.body("flange").xpos, X_BF[:3, 3], atol=1e-9)
            np.testing.assert_allclose(
                data.body("flange").xmat.reshape(3, 3), X_BF[:3, :3], atol=1e-9
            )


def test_a_search_from_random_joint_angles_finds_no_further_solution(poses):
    """Newton's method from 300 places for each pose ends on one of the closed form's solutions,
    or nowhere.
    """
    zero = np.zeros(6)
    newton = KinematicCalibration.from_dh_corrections(theta=zero, d=zero, a=zero, alpha=zero)
    starts = np.random.default_rng(5).uniform(-np.pi, np.pi, (300, 6))
    found_all = 0
    for X_BF in poses[:15]:
        found = newton.refined(starts, np.broadcast_to(X_BF, (len(starts), 4, 4)))
        found = found[~np.isnan(found[:, 0])]
        known = kinematics.inverse(X_BF)
        apart = np.abs(np.angle(np.exp(1j * (found[:, None] - known[None])))).max(axis=-1)
        assert apart.min(axis=1).max() < 1e-6
        found_all += len(np.unique(apart.argmin(axis=1))) == len(known)
    assert found_all > 10
