import cv2
import numpy as np
import pytest

from breastscan.run.metrics import rms
from experiments.paper import calibration, hand_eye, rig_tables
from tests.vision.board_shots import SIZE


def values(item, name):
    return next(v for column, v in item.data.items() if column.name == name)


@pytest.fixture(scope="module")
def items(calibrated, placed):
    found = [
        *calibration.items(calibrated),
        *rig_tables.items(calibrated),
        *hand_eye.items(placed),
    ]
    return {item.heading: item for item in found}


def test_rows_of_the_same_corner_are_those_that_opencv_rectifies_them_to(calibrated):
    rig = calibrated.result.rig
    pair = rig.rectify(calibrated.pair.left, calibrated.pair.right)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        rig.left.K, rig.left.distortion, rig.right.K, rig.right.distortion, SIZE,
        rig.X_RL[:3, :3], rig.X_RL[:3, 3], flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1,
    )  # fmt: skip
    shots = calibrated.result.shots
    rows = [
        cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion, R=R, P=P)[:, 0, 1]
        for camera, R, P, pixels in (
            (rig.left, R1, P1, shots[0].left), (rig.right, R2, P2, shots[0].right),
        )
    ]  # fmt: skip
    found = calibration.row_differences_px(rig, pair, shots)
    assert found[0] == pytest.approx(rms(rows[0] - rows[1]), rel=1e-6)
    assert found.max() < 0.1


def test_found_corners_are_off_by_the_noise_that_was_put_on_them(items):
    """.02 px along each axis, which is .028 px of distance."""
    for side in ("left", "right"):
        assert rms(values(items["Fig. 2"], f"{side}_px")) == pytest.approx(0.028, rel=0.1)


def test_the_tables_give_the_truth_beside_what_was_found(items, calibrated):
    table = items["Table 1"]
    names, paper, ours = (values(table, name) for name in ("parameter", "paper", "ours"))
    assert paper[names == "fx"].tolist() == [340.0, 342.0]
    assert np.abs(ours - paper)[names == "fx"].max() < 0.5
    translation = values(items["Table 2"], "paper")[-3:]
    np.testing.assert_allclose(translation, 1e3 * calibrated.truth.X_RL[:3, 3])


def test_the_printed_matrix_turns_by_eleven_and_a_half_degrees(items):
    assert "by 11.5°" in items["Eq. 32"].why
    assert "0.972 to 0.985" in items["Eq. 32"].why
    tilted = cv2.Rodrigues(np.array([0.3, 0.0, 0.0]))[0]
    assert hand_eye.nearest_turn_deg(0.9 * tilted) == pytest.approx(np.degrees(0.3))
