from dataclasses import replace

import numpy as np
import pytest

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.calibration import board_pose
from breastscan.vision.hand_eye import CLOSED_FORMS, closed_form, hand_eye, same_end
from tests.vision.board_shots import BOARD, flange_poses, make_rig, shots_of

X_FBoard = se3.from_rotation_vector(np.array([0.02, -0.01, 0.3]), np.array([-0.27, -0.05, 0.12]))
POSITION_NOISE, ROTATION_NOISE = 5e-5, np.radians(0.01)


@pytest.fixture(scope="module")
def rig():
    return make_rig()


@pytest.fixture(scope="module")
def X_BF(rig):
    return flange_poses(rig, X_FBoard, 30, np.random.default_rng(0))


def shots_at(rig, X_BF, noise_px):
    return shots_of(
        rig, se3.inverse(rig.X_BL) @ X_BF @ X_FBoard, np.random.default_rng(1), noise_px
    )


def stated(X_BF):
    rng = np.random.default_rng(2)
    rotation_vectors = ROTATION_NOISE * rng.standard_normal((len(X_BF), 3))
    shifts = POSITION_NOISE * rng.standard_normal((len(X_BF), 3))
    return X_BF @ se3.from_rotation_vector(rotation_vectors, shifts)


def error(X_AB, truth):
    between = se3.inverse(truth) @ X_AB
    return np.linalg.norm(between[:3, 3]) * 1e3, np.degrees(
        np.linalg.norm(se3.rotation_vector(between))
    )


def without_place(rig):
    return replace(rig, X_BL=None)


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_closed_forms_are_exact_without_noise(rig, X_BF, name):
    X_LBoard = np.array([board_pose(rig, shot, BOARD) for shot in shots_at(rig, X_BF, 0.0)])
    distance_mm, angle_deg = error(closed_form(X_BF, X_LBoard, CLOSED_FORMS[name]), rig.X_BL)
    assert distance_mm < 0.05
    assert angle_deg < 0.005


def test_the_cameras_are_placed_within_a_fifth_of_a_millimetre_by_an_arm_that_is_not_exact(
    rig, X_BF
):
    result = hand_eye(shots_at(rig, X_BF, 0.02), stated(X_BF), without_place(rig), BOARD)
    distance_mm, angle_deg = error(result.rig.X_BL, rig.X_BL)
    assert distance_mm < 0.2
    assert angle_deg < 0.02
    assert result.reprojection_px < 0.03
    assert result.disagreement[0] < 2e-3


def test_a_yaw_error_of_the_rig_is_mended(rig, X_BF):
    """.02 degrees of yaw cost about .8 mm of depth."""
    wrong = replace(
        rig,
        X_BL=None,
        X_RL=rig.X_RL @ se3.from_rotation_vector(np.radians([0, 0.02, 0]), np.zeros(3)),
    )
    result = hand_eye(shots_at(rig, X_BF, 0.02), stated(X_BF), wrong, BOARD)
    assert error(result.rig.X_RL, rig.X_RL)[1] < 0.005


def test_the_ends_of_a_plain_board_are_told_apart_by_the_arm(rig, X_BF):
    shots = shots_at(rig, X_BF, 0.02)
    flipped = np.random.default_rng(3).uniform(size=len(shots)) < 0.5
    mixed = [
        shot.half_turned() if half else shot for shot, half in zip(shots, flipped, strict=True)
    ]
    sorted_out = same_end(mixed, stated(X_BF), rig, BOARD)
    same = np.array(
        [np.array_equal(out.left, shot.left) for out, shot in zip(sorted_out, shots, strict=True)]
    )
    assert same.all() or not same.any()
    distance_mm, _ = error(
        hand_eye(mixed, stated(X_BF), without_place(rig), BOARD).rig.X_BL, rig.X_BL
    )
    assert distance_mm < 0.2


def test_too_little_tilt_is_refused(rig):
    X_BF = flange_poses(rig, X_FBoard, 30, np.random.default_rng(0), tilt_deg=(0, 8))
    with pytest.raises(CalibrationError, match="tilt the board"):
        hand_eye(shots_at(rig, X_BF, 0.02), X_BF, without_place(rig), BOARD)


def test_too_few_poses_are_refused(rig, X_BF):
    with pytest.raises(CalibrationError, match="9 poses"):
        hand_eye(shots_at(rig, X_BF[:9], 0.02), X_BF[:9], without_place(rig), BOARD)


def test_poses_of_other_shots_are_refused(rig, X_BF):
    with pytest.raises(CalibrationError, match="belong to these shots"):
        hand_eye(shots_at(rig, X_BF, 0.02), np.roll(X_BF, 1, axis=0), without_place(rig), BOARD)
