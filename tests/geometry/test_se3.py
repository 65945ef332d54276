"""Group laws of poses, and agreement with SciPy's rotations."""

import re
import tokenize
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3

NUMBERS = st.floats(-2.0, 2.0)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)
POSES = st.tuples(VECTORS, VECTORS).map(lambda parts: se3.from_rotation_vector(*parts))
ROOT = Path(__file__).parents[2]
LETTER = "(?:Board|[A-Z0-9])"
MONOGRAM = re.compile(
    rf"_?[XR]_({LETTER}+)(?:_\w+)?"  # a pose or a rotation: X_BP, R_LV
    rf"|_?[a-z][a-z0-9_]*_((?:Board|[A-Z]){{1,2}})(?:_[a-z0-9_]+)?"  # a vector and its basis: p_B
)


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


@pytest.mark.parametrize("n", [[0.0, 0, 1], [0, 0, -1], [1, 0, 0], [-0.48, 0.6, 0.64]])
def test_axes_along_a_vector_are_a_right_handed_basis_with_it_last(n):
    R = se3.axes_along(np.array(n, float))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_array_equal(R[2], n)


def test_what_goes_across_an_axis_leaves_out_what_goes_along():
    axis = np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
    v = np.array([[1.0, 2.0, 3.0], [1.2, 1.6, 5.0]])
    np.testing.assert_allclose(se3.across(v, axis), [[1, 2, 0], [0, 0, 5]], atol=1e-15)


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


def letters_of(name: str) -> list[str]:
    """The frames in the monogram of an identifier; none where it has none."""
    found = MONOGRAM.fullmatch(name)
    return re.findall("Board|[A-Z0-9]", found[1] or found[2]) if found else []


def frames_in_the_table() -> set[str]:
    rows = re.findall(r"^\| ([A-Z0-9].*?) \|", se3.__doc__ or "", flags=re.MULTILINE)
    return {letter for row in rows for letter in row.split(", ")}


@pytest.mark.parametrize(
    ("name", "letters"),
    [
        ("X_BP", ["B", "P"]),
        ("_X_LBoard", ["L", "Board"]),
        ("X_6F", ["6", "F"]),
        ("p_BS", ["B", "S"]),
        ("points_B", ["B"]),
        ("X_BL_best", ["B", "L"]),
        ("HOME_Q", []),
        ("_wrist_2", []),
        ("X_joints", []),
    ],
)
def test_a_monogram_is_read_from_a_name(name, letters):
    assert letters_of(name) == letters


def test_every_frame_in_use_stands_in_the_table():
    known = frames_in_the_table()
    assert {"W", "B", "L", "R", "Board"} <= known
    for folder in ("breastscan", "sim", "experiments", "tests"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            with path.open("rb") as file:
                names = {
                    t.string for t in tokenize.tokenize(file.readline) if t.type == tokenize.NAME
                }
            for name in names:
                unknown = set(letters_of(name)) - known
                assert not unknown, f"{path}: {name} names the frame {unknown.pop()}"
