import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from breastscan.geometry import kinematics, se3
from tests.geometry.dh_frames import dh_frames

joint_angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)


def random_joint_angles(count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-np.pi, np.pi, (count, 6))


@settings(deadline=None, max_examples=50)
@given(joint_angles)
def test_forward_is_the_product_of_the_dh_matrices(q):
    np.testing.assert_allclose(kinematics.forward(q), dh_frames(q)[-1], atol=1e-12)


def test_arm_is_stretched_along_minus_x_at_zero_as_universal_robots_define_it():
    np.testing.assert_allclose(
        kinematics.forward(np.zeros(6))[:3, 3], [-0.8172, -0.2329, 0.0628], atol=1e-12
    )


def test_every_solution_of_the_inverse_reaches_the_pose_within_a_nanometre():
    X_BF = kinematics.forward(random_joint_angles(2000))
    q = kinematics.inverse_branches(X_BF)
    exists = ~np.isnan(q).any(axis=-1)
    X_reached = kinematics.forward(q[exists])
    np.testing.assert_allclose(X_reached, np.repeat(X_BF[:, None], 8, axis=1)[exists], atol=1e-9)
    assert exists.any(axis=1).all()


def test_the_angles_that_made_a_pose_are_among_its_solutions():
    q = random_joint_angles(2000)
    branches = kinematics.inverse_branches(kinematics.forward(q))
    apart = np.abs(np.angle(np.exp(1j * (branches - q[:, None]))))
    assert np.nanmin(apart.max(axis=-1), axis=1).max() < 1e-7


def test_a_generic_pose_has_eight_different_solutions():
    q = kinematics.inverse(
        kinematics.forward(np.radians([20.0, -100.0, 110.0, -70.0, -60.0, 30.0]))
    )
    assert q.shape == (8, 6)
    apart = np.abs(q[:, None] - q[None]).max(axis=-1)
    assert apart[~np.eye(8, dtype=bool)].min() > 0.1


def test_branches_keep_their_index_along_a_continuous_motion():
    ends = np.radians(
        [[20.0, -100.0, 110.0, -70.0, -60.0, 30.0], [60.0, -80.0, 90.0, -90.0, -80.0, 80.0]]
    )
    q = ends[0] + np.linspace(0.0, 1.0, 200)[:, None] * (ends[1] - ends[0])
    branches = kinematics.inverse_branches(kinematics.forward(q))
    index = np.nanargmin(np.abs(branches - q[:, None]).max(axis=-1), axis=1)
    assert len(set(index)) == 1
    np.testing.assert_allclose(branches[:, index[0]], q, atol=1e-8)


def test_a_pose_beyond_reach_has_no_solution_and_says_by_how_much():
    q = np.radians([10.0, -70.0, 0.0, -20.0, -90.0, 0.0])  # the elbow is stretched
    X_BF = kinematics.forward(q)
    frames = dh_frames(q)
    outwards = (frames[3, :3, 3] - frames[1, :3, 3]) / np.linalg.norm(
        frames[3, :3, 3] - frames[1, :3, 3]
    )
    X_BF[:3, 3] += 0.020 * outwards
    assert kinematics.inverse(X_BF).shape == (0, 6)
    assert kinematics.reach_excess(X_BF) * 1e3 == pytest.approx(20.0, abs=0.5)


def test_a_pose_inside_the_shoulder_offset_has_no_solution():
    X_BF = se3.pose(np.eye(3), np.array([0.05, 0.0, 0.4]))
    assert kinematics.inverse(X_BF).shape == (0, 6)
    assert kinematics.reach_excess(X_BF) * 1e3 == pytest.approx(133.3 - 50.0)


def test_reach_excess_is_zero_exactly_where_a_solution_exists():
    rng = np.random.default_rng(5)
    X_BF = kinematics.forward(random_joint_angles(500))
    X_BF[:, :3, 3] += rng.normal(0.0, 0.3, (500, 3))
    solvable = ~np.isnan(kinematics.inverse_branches(X_BF)[..., 0]).all(axis=1)
    np.testing.assert_array_equal(kinematics.reach_excess(X_BF) == 0.0, solvable)


def test_the_folded_wrist_is_solved_with_joint_six_at_zero():
    X_BF = kinematics.forward(np.radians([20.0, -100.0, 110.0, -70.0, 0.0, 30.0]))
    q = kinematics.inverse(X_BF)
    np.testing.assert_allclose(
        kinematics.forward(q), np.broadcast_to(X_BF, (len(q), 4, 4)), atol=1e-9
    )
    assert np.any(q[:, 5] == 0.0)


def test_jacobian_is_the_derivative_of_the_flange():
    q, step = random_joint_angles(1)[0], 1e-6
    J = kinematics.jacobian(q)
    for joint, change in enumerate(np.eye(6) * step):
        X_before, X_after = kinematics.forward(np.stack([q - change, q + change]))
        linear = (X_after[:3, 3] - X_before[:3, 3]) / (2 * step)
        angular = se3.rotation_vector(X_after @ se3.inverse(X_before))[:3] / (2 * step)
        np.testing.assert_allclose(J[:, joint], np.concatenate([linear, angular]), atol=1e-8)


def test_batched_calls_equal_single_ones():
    q = random_joint_angles(6).reshape(2, 3, 6)
    np.testing.assert_array_equal(kinematics.jacobian(q)[1, 2], kinematics.jacobian(q[1, 2]))
    np.testing.assert_array_equal(kinematics.forward(q)[1, 2], kinematics.forward(q[1, 2]))
    np.testing.assert_array_equal(
        kinematics.inverse_branches(kinematics.forward(q))[0, 1],
        kinematics.inverse_branches(kinematics.forward(q[0, 1])),
    )


def test_singularity_factors_multiply_to_the_jacobian_determinant():
    q = random_joint_angles(200)
    a2, a3 = -0.425, -0.3922
    product = np.prod(kinematics.singularity_factors(q), axis=-1) * a2 * a3 * (a2 + a3)
    np.testing.assert_allclose(np.linalg.det(kinematics.jacobian(q)), product, atol=1e-12)


def test_link_heights_are_those_of_the_link_frames():
    q = random_joint_angles(50)
    frames = np.array([dh_frames(one) for one in q])
    np.testing.assert_allclose(kinematics.link_heights(q), frames[..., 2, 3], atol=1e-14)


@pytest.mark.parametrize("q_deg", [[0, -90, 0, -90, -90, 0], [0, -100, 110, -70, 0, 0]])
def test_singularity_measure_vanishes_at_stretched_elbow_and_folded_wrist(q_deg):
    assert kinematics.singularity_measure(np.radians(np.array(q_deg, float))) < 1e-12
