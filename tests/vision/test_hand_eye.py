from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.boards.arm_loop import CLOSED_FORMS, closed_form, same_end
from breastscan.vision.calibration import board_pose
from breastscan.vision.hand_eye import hand_eye
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


def scaled(rig, baseline=1.0, focal=1.0):
    """The rig file of other cameras."""
    zoom = np.array([[focal, 1, 1], [1, focal, 1], [1, 1, 1]])
    return replace(
        rig,
        left=replace(rig.left, K=rig.left.K * zoom),
        right=replace(rig.right, K=rig.right.K * zoom),
        X_RL=se3.pose(rig.X_RL[:3, :3], baseline * rig.X_RL[:3, 3]),
        X_BL=None,
    )


def slipped(X_BF, kept):
    """The board turned and moved in its holder after some of the shots."""
    X_FF = se3.from_rotation_vector(np.array([0, 0, 0.05]), np.array([0.01, 0, 0]))
    return np.concatenate([X_BF[:kept], X_BF[kept:] @ X_FF])


def noisy(X_BF, distance, angle):
    rng = np.random.default_rng(5)
    turned = np.radians(angle) * rng.standard_normal((len(X_BF), 3))
    return X_BF @ se3.from_rotation_vector(turned, distance * rng.standard_normal((len(X_BF), 3)))


MISTAKEN = {
    "inverse poses": (se3.inverse, "inverted"),
    "rows shifted down": (lambda X: np.roll(X, 1, axis=0), "1 row after its own"),
    "rows shifted up": (lambda X: np.roll(X, -2, axis=0), "2 rows before its own"),
    "shuffled": (
        lambda X: X[np.random.default_rng(4).permutation(len(X))], "belong to these shots",
    ),
    "transposed rotations": (
        lambda X: se3.pose(X[:, :3, :3].swapaxes(1, 2), X[:, :3, 3]), "belong to these shots",
    ),
    "half of them after a slip": (lambda X: slipped(X, 15), "belong to these shots"),
    "an arm that is 2 mm off": (lambda X: noisy(X, 2e-3, 0.2), "one sigma"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKEN)
def test_poses_that_do_not_fit_are_refused_with_what_they_are(mistake, rig, X_BF):
    wrong, cause = MISTAKEN[mistake]
    with pytest.raises(CalibrationError, match=cause):
        hand_eye(shots_at(rig, X_BF, 0.02), wrong(stated(X_BF)), without_place(rig), BOARD)


def test_a_rotation_read_in_another_way_is_named(rig, X_BF):
    read = se3.from_rotation_vector(
        Rotation.from_matrix(X_BF[:, :3, :3]).as_euler("xyz"), X_BF[:, :3, 3]
    )
    with pytest.raises(CalibrationError, match="read as roll pitch yaw"):
        hand_eye(
            shots_at(rig, X_BF, 0.02), read, without_place(rig), BOARD, {"roll pitch yaw": X_BF}
        )


@pytest.mark.parametrize(
    ("baseline", "focal", "square", "cause"),
    [
        (1.0, 1.0, 1.05, "squares are 25.0. mm, not 26.25"),
        (1.0, 1.0, 1.005, "squares are 25.0. mm, not 25.125"),
        (1.05, 1.0, 1.05, "squares are 25.0. mm, not 26.25"),
        (1.05, 1.0, 1.0, "stand 100... mm apart, by the rig file 105"),
        (1.0, 1.02, 1.0, "focal length is 34... px, by the rig file 34"),
    ],
)
def test_a_wrong_length_is_found_by_the_arm(baseline, focal, square, cause, rig, X_BF):
    board = replace(BOARD, square=square * BOARD.square)
    with pytest.raises(CalibrationError, match=cause):
        hand_eye(shots_at(rig, X_BF, 0.02), stated(X_BF), scaled(rig, baseline, focal), board)


def test_a_square_that_is_a_little_wrong_is_measured(rig, X_BF):
    """A fifth of a per cent too large would place the cameras .8 mm too far."""
    board = replace(BOARD, square=1.002 * BOARD.square)
    result = hand_eye(shots_at(rig, X_BF, 0.02), stated(X_BF), without_place(rig), board)
    assert result.square == pytest.approx(BOARD.square, rel=5e-4)
    assert error(result.rig.X_BL, rig.X_BL)[0] < 0.6


@pytest.mark.parametrize("off", [0.002, 0.005, 0.02, 0.05])
def test_a_pose_that_is_off_is_left_out_by_name(off, rig, X_BF):
    shots, wrong = shots_at(rig, X_BF, 0.02), stated(X_BF)
    wrong[7, :3, 3] += off * np.array([0.48, -0.6, 0.64])
    others = np.delete(np.arange(30), 7)
    without = hand_eye([shots[k] for k in others], wrong[others], without_place(rig), BOARD)
    result = hand_eye(shots, wrong, without_place(rig), BOARD)
    assert list(result.dropped) == ["07"]
    np.testing.assert_allclose(result.rig.X_BL, without.rig.X_BL, atol=2e-6)


def test_two_exchanged_rows_are_left_out(rig, X_BF):
    wrong = stated(X_BF)
    wrong[[4, 11]] = wrong[[11, 4]]
    result = hand_eye(shots_at(rig, X_BF, 0.02), wrong, without_place(rig), BOARD)
    assert sorted(result.dropped) == ["04", "11"]


def test_the_stated_uncertainty_is_that_of_the_errors(rig):
    """Over ten sets the squared error over its variance is a chi-square of six a set: 32 to 94 in
    99 of 100 cases.
    """
    total = 0.0
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        X_BF = flange_poses(rig, X_FBoard, 20, rng)
        seen = shots_of(rig, se3.inverse(rig.X_BL) @ X_BF @ X_FBoard, rng, 0.03)
        turned = ROTATION_NOISE * rng.standard_normal((20, 3))
        shifts = POSITION_NOISE * rng.standard_normal((20, 3))
        wrong = X_BF @ se3.from_rotation_vector(turned, shifts)
        result = hand_eye(seen, wrong, without_place(rig), BOARD)
        between = se3.inverse(rig.X_BL) @ result.rig.X_BL
        off = np.concatenate([se3.rotation_vector(between), between[:3, 3]])
        total += off @ np.linalg.solve(result.covariance, off)
    assert 20 < total < 94
