import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration


def corrections(seed: int = 0) -> dict[str, np.ndarray]:
    """As large as a real arm's; the nearly parallel axes 2 and 3 take large offsets that cancel
    each other.
    """
    rng = np.random.default_rng(seed)
    values = {
        "theta": rng.normal(0.0, 1e-3, 6),
        "d": rng.normal(0.0, 5e-4, 6),
        "a": rng.normal(0.0, 5e-4, 6),
        "alpha": rng.normal(0.0, 1e-3, 6),
    }
    values["d"][1:3] += [0.3, -0.3]
    return values


@pytest.fixture(scope="module")
def arm() -> KinematicCalibration:
    return KinematicCalibration.from_dh_corrections(**corrections())


def random_joint_angles(count: int) -> np.ndarray:
    """Away from singularities, where branches meet."""
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (3 * count, 6))
    return q[kinematics.singularity_measure(q) > 0.1][:count]


def test_without_corrections_it_is_the_nominal_arm():
    arm = KinematicCalibration.nominal()
    q = random_joint_angles(50)
    np.testing.assert_allclose(arm.forward(q), kinematics.forward(q), atol=1e-12)
    np.testing.assert_allclose(arm.jacobian(q), kinematics.jacobian(q), atol=1e-12)


def test_forward_is_the_product_of_the_corrected_dh_matrices(arm):
    values, q = corrections(), random_joint_angles(1)[0]
    X = np.eye(4)
    for j in range(6):
        rotation = Rotation.from_euler("z", q[j] + values["theta"][j]).as_matrix()
        twist = Rotation.from_euler("x", kinematics.DH_ALPHA[j] + values["alpha"][j]).as_matrix()
        X = X @ se3.pose(rotation, np.array([0.0, 0.0, kinematics.DH_D[j] + values["d"][j]]))
        X = X @ se3.pose(twist, np.array([kinematics.DH_A[j] + values["a"][j], 0.0, 0.0]))
    np.testing.assert_allclose(arm.forward(q), X, atol=1e-12)


def test_the_flange_is_millimetres_from_where_the_nominal_arm_has_it(arm):
    q = random_joint_angles(200)
    apart_mm = 1e3 * np.linalg.norm(
        arm.forward(q)[:, :3, 3] - kinematics.forward(q)[:, :3, 3], axis=1
    )
    assert 0.5 < np.median(apart_mm) < 10.0


def test_every_branch_reaches_the_pose_within_a_nanometre_and_a_nanoradian(arm):
    X_BF = arm.forward(random_joint_angles(500))
    branches = arm.inverse_branches(X_BF)
    exists = ~np.isnan(branches[..., 0])
    X_reached = arm.forward(branches[exists])
    X_goal = np.repeat(X_BF[:, None], 8, axis=1)[exists]
    np.testing.assert_allclose(X_reached[:, :3, 3], X_goal[:, :3, 3], atol=1e-9)
    rotation_vectors = se3.rotation_vector(se3.inverse(X_reached) @ X_goal)
    assert np.linalg.norm(rotation_vectors, axis=1).max() < 1e-9


def test_no_branch_is_lost_away_from_singularities(arm):
    q = random_joint_angles(2000)
    X_BF = arm.forward(q)
    branches = arm.inverse_branches(X_BF)
    apart = np.abs(np.angle(np.exp(1j * (branches - q[:, None])))).max(axis=-1)
    assert np.nanmin(apart, axis=1).max() < 1e-9
    nominal = kinematics.inverse_branches(X_BF)
    clear = kinematics.singularity_measure(np.nan_to_num(nominal)) > 0.15
    assert not np.isnan(branches[clear & ~np.isnan(nominal[..., 0])]).any()


def test_jacobian_is_the_derivative_of_forward(arm):
    q, step = random_joint_angles(1)[0], 1e-6
    J = arm.jacobian(q)
    for joint, change in enumerate(np.eye(6) * step):
        X_before, X_after = arm.forward(np.stack([q - change, q + change]))
        linear = (X_after[:3, 3] - X_before[:3, 3]) / (2 * step)
        angular = se3.rotation_vector(X_after @ se3.inverse(X_before)) / (2 * step)
        np.testing.assert_allclose(J[:, joint], np.concatenate([linear, angular]), atol=1e-8)


def test_a_pose_out_of_reach_has_no_solution(arm):
    assert arm.inverse(se3.pose(np.eye(3), np.array([1.5, 0.0, 0.3]))).shape == (0, 6)
