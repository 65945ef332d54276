"""Group laws of poses, and agreement with SciPy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3

NUMBERS = st.floats(-2.0, 2.0)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)
POSES = st.tuples(VECTORS, VECTORS).map(lambda parts: se3.from_rotation_vector(*parts))


@given(POSES)
def test_a_pose_times_its_inverse_is_the_identity(X_AB):
    np.testing.assert_allclose(X_AB @ se3.inverse(X_AB), np.eye(4), atol=1e-12)


@given(POSES, POSES, VECTORS)
def test_transforming_twice_is_transforming_by_the_product(X_AB, X_BC, p_C):
    np.testing.assert_allclose(
        se3.transform(X_AB, se3.transform(X_BC, p_C)), se3.transform(X_AB @ X_BC, p_C), atol=1e-12
    )


@given(POSES, VECTORS, VECTORS)
def test_a_pose_keeps_lengths_and_angles(X_AB, a_B, b_B):
    assert se3.rotate(X_AB, a_B) @ se3.rotate(X_AB, b_B) == pytest.approx(a_B @ b_B, abs=1e-11)


@given(VECTORS)
def test_the_rotation_vector_comes_back(r):
    length = np.linalg.norm(r)
    r = r if length < 3.1 else r * 3.1 / length
    np.testing.assert_allclose(
        se3.rotation_vector(se3.from_rotation_vector(r, np.zeros(3))), r, atol=1e-7
    )


def test_poses_come_back_from_their_quaternions_and_unknown_ones_stay_unknown():
    rng = np.random.default_rng(1)
    X = se3.from_rotation_vector(3 * rng.normal(size=(50, 3)), rng.normal(size=(50, 3)))
    X[[0, 20, 21]] = np.nan
    q = se3.quaternion(X)
    np.testing.assert_allclose(np.linalg.norm(q[1:20], axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(se3.from_quaternion(q, X[:, :3, 3]), X, rtol=0, atol=1e-12)
    assert np.isnan(se3.quaternion(X[:1])).all()


def test_every_function_is_batched():
    rng = np.random.default_rng(0)
    r, p = rng.normal(size=(5, 4, 3)), rng.normal(size=(5, 4, 3))
    X = se3.from_rotation_vector(r, p)
    assert X.shape == (5, 4, 4, 4)
    np.testing.assert_allclose(se3.inverse(X)[2, 3], se3.inverse(X[2, 3]), atol=1e-15)
    np.testing.assert_allclose(
        X[1, 1, :3, :3], Rotation.from_rotvec(r[1, 1]).as_matrix(), atol=1e-15
    )
    assert se3.rotation_vector(X).shape == (5, 4, 3)


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 1.0, np.pi - 1e-9])
def test_angles_are_exact_near_zero_and_near_pi(angle):
    a = np.array([1.0, 0.0, 0.0])
    b = np.array([np.cos(angle), np.sin(angle), 0.0])
    assert se3.angle_between(a, b) == pytest.approx(angle, abs=1e-15)
