"""What is drawn of a calibration is named, has its unit, and lies inside the picture."""

import numpy as np

from breastscan.geometry import se3
from breastscan.report import calibration_figures as draw

BOARD = np.array([(x, y, 0.0) for y in (0.0, 0.03) for x in (0.0, 0.03, 0.06)])
AHEAD = se3.pose(np.eye(3), np.array([0.0, 0.0, 0.4]))


def names(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_corners_are_shown_from_close_by_and_whole():
    picture = np.full((1024, 1280), 200, np.uint8)
    pixels = np.array([(30.0, 990.0), (230.0, 990.0), (30.0, 900.0)])
    (axis,) = draw.corners([picture], [pixels], ["Left"], columns=1).axes
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    assert 0 <= left < 30 < 230 < right <= 1280
    assert 0 <= top < 900 < 990 < bottom <= 1024
    assert right - left < 500


def test_boards_and_cameras_are_told_apart_by_name():
    figure = draw.board_places(np.stack([AHEAD, AHEAD]), BOARD, np.eye(4))
    assert names(figure) == ["board", "left camera", "right camera"]
    axis = figure.axes[0]
    assert all("[m]" in label for label in (axis.get_xlabel(), axis.get_ylabel()))


def test_frames_of_the_hand_eye_calibration_are_named():
    figure = draw.hand_eye_frames(np.stack([AHEAD, AHEAD]), np.eye(4), [AHEAD], BOARD)
    assert names(figure)[:2] == ["board", "cameras"]
    assert [name[0] for name in names(figure)[2:]] == ["x", "y", "z"]
