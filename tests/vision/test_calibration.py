from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.board import BoardShot
from breastscan.vision.boards.bundle import reprojection
from breastscan.vision.boards.calibration_quality import (
    Quality,
    QualityLimits,
    complaints,
    tilt_spread,
)
from breastscan.vision.calibration import board_pose, calibrate, fit_pose
from tests.vision.board_shots import BOARD, SIZE, make_rig, poses_in_view, shots_of


@pytest.fixture(scope="module")
def rig():
    return make_rig()


@pytest.fixture(scope="module")
def X_LBoard(rig):
    return poses_in_view(rig, 20, np.random.default_rng(0))


@pytest.fixture(scope="module")
def shots(rig, X_LBoard):
    return shots_of(rig, X_LBoard, np.random.default_rng(1))


@pytest.fixture(scope="module")
def calibration(shots):
    return calibrate(shots, SIZE, BOARD)


def test_the_pair_is_found_from_noisy_corners(rig, calibration):
    rotation_deg = np.degrees(se3.rotation_vector(calibration.rig.X_RL @ se3.inverse(rig.X_RL)))
    assert abs(calibration.rig.baseline - rig.baseline) * 1e3 < 0.05
    assert np.abs(rotation_deg).max() < 0.02
    np.testing.assert_allclose(calibration.rig.left.K, rig.left.K, atol=0.2)
    np.testing.assert_allclose(calibration.rig.right.K, rig.right.K, atol=0.2)


def test_the_residual_is_that_of_the_corners_noise(calibration):
    """Two axes of .02 px, less what the fitted parameters take up."""
    assert 0.022 < calibration.reprojection_px < 0.02 * np.sqrt(2)
    assert calibration.dropped == {}


def test_the_boards_are_where_they_were(calibration, X_LBoard):
    assert np.linalg.norm(calibration.X_LBoard[:, :3, 3] - X_LBoard[:, :3, 3], axis=1).max() < 5e-4


def test_a_shot_that_does_not_fit_is_named_and_dropped(rig, shots):
    moved = BoardShot(name="moved", left=shots[3].left, right=shots[3].right + np.array([1.5, 0.7]))
    calibration = calibrate([*shots[:3], moved, *shots[4:]], SIZE, BOARD)
    assert list(calibration.dropped) == ["moved"]
    assert "px" in calibration.dropped["moved"]
    assert abs(calibration.rig.baseline - rig.baseline) * 1e3 < 0.05


@pytest.mark.parametrize(
    "distortion",
    [[-0.07, 0.11, 5e-4, -8e-4], [0.3, 0.1, 5e-4, -8e-4, 0.01, 0.37, 0.12, 0.015]],
    ids=["4 coefficients", "8"],
)
def test_lenses_of_other_models_are_found(distortion, rig, X_LBoard):
    """Where a point of the view is seen, to a third of a pixel all over the picture."""
    left, right = (replace(c, distortion=np.array(distortion)) for c in (rig.left, rig.right))
    true = replace(rig, left=left, right=right)
    seen = shots_of(true, X_LBoard, np.random.default_rng(5))
    found = calibrate(seen, SIZE, BOARD, lens=len(distortion), accept=True).rig
    assert found.left.distortion.shape == (len(distortion),)
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 9), np.linspace(-0.55, 0.55, 7))
    view = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    there, here = (
        cv2.projectPoints(view, np.zeros(3), np.zeros(3), c.K, c.distortion)[0][:, 0]
        for c in (left, found.left)
    )
    assert np.sqrt(((there - here) ** 2).sum(axis=1).mean()) < 0.33
    assert abs(found.baseline - rig.baseline) * 1e3 < 0.05


def test_swapped_cameras_are_noticed(shots):
    swapped = [BoardShot(name=shot.name, left=shot.right, right=shot.left) for shot in shots]
    with pytest.raises(CalibrationError, match="swapped"):
        calibrate(swapped, SIZE, BOARD)


def test_too_few_shots_are_refused(shots):
    with pytest.raises(CalibrationError, match="5 usable shots"):
        calibrate(shots[:5], SIZE, BOARD)


def test_shots_in_the_middle_of_the_image_alone_are_refused(rig):
    X = poses_in_view(rig, 14, np.random.default_rng(2), width_fraction=0.15)
    with pytest.raises(CalibrationError, match=r"cover .* of the left and"):
        calibrate(shots_of(rig, X, np.random.default_rng(3)), SIZE, BOARD)


GOOD = {"coverage": (0.8, 0.8), "tilt_spread": 0.3, "held_out_px": 0.05, "fit_px": 0.04}


@pytest.mark.parametrize(
    ("poor", "reason"),
    [
        ({"coverage": (0.8, 0.2)}, "right image"),
        ({"tilt_spread": 0.02}, "tilt"),
        ({"fit_px": 2.0, "held_out_px": 2.0}, "is the board flat"),
        ({"held_out_px": 0.2}, "held out"),
    ],
)
def test_of_a_poor_set_the_reason_is_told(poor, reason):
    assert complaints(Quality(**GOOD), QualityLimits()) == []
    (told,) = complaints(Quality(**GOOD | poor), QualityLimits())
    assert reason in told


def test_limits_can_be_set_and_a_set_that_misses_them_accepted_with_its_warnings(shots):
    limits = QualityLimits(coverage=0.99)
    with pytest.raises(CalibrationError, match=r"99% are needed.*--accept"):
        calibrate(shots, SIZE, BOARD, limits)
    accepted = calibrate(shots, SIZE, BOARD, limits, accept=True)
    (warning,) = accepted.warnings
    assert "99% are needed" in warning


def test_pictures_of_two_instants_are_named_before_they_are_fitted(rig, shots, calibration):
    """The right picture of a shot was taken when the board had moved on, by 20 mm at least."""
    mixed = list(shots)
    mixed[3] = BoardShot(name="late", left=shots[3].left, right=shots[9].right)
    found = calibrate(mixed, SIZE, BOARD)
    assert found.dropped == {"late": "left and right are not of one instant"}
    assert abs(found.rig.baseline - rig.baseline) * 1e3 < 0.05


def test_boards_that_tilt_about_one_axis_alone_have_no_spread():
    tilts = np.linspace(-0.7, 0.7, 9)[:, None] * np.array([1.0, 0, 0])
    assert tilt_spread(se3.from_rotation_vector(tilts, np.zeros((9, 3)))) == pytest.approx(
        0, abs=1e-6
    )


def test_the_fitted_pose_agrees_with_scipys():
    rng = np.random.default_rng(4)
    points = rng.standard_normal((8, 3))
    X_AB = se3.from_rotation_vector(np.array([0.3, -1.2, 0.8]), np.array([1.0, 2.0, 3.0]))
    noisy = se3.transform(X_AB, points) + 0.01 * rng.standard_normal((8, 3))
    expected, _ = Rotation.align_vectors(noisy - noisy.mean(axis=0), points - points.mean(axis=0))
    np.testing.assert_allclose(fit_pose(points, noisy)[:3, :3], expected.as_matrix(), atol=1e-9)


def test_a_boards_pose_follows_from_both_pictures(rig, X_LBoard):
    shot = shots_of(rig, X_LBoard[:1], np.random.default_rng(0), noise_px=0.0)[0]
    X = board_pose(rig, shot, BOARD)
    np.testing.assert_allclose(X, X_LBoard[0], atol=1e-5)
    assert np.abs(reprojection(rig, X[None], [shot], BOARD)).max() < 0.01
