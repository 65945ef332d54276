import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.vision.board import Board, find_corners, find_shot
from tests.vision.board_shots import BOARD, SIZE, make_rig, picture, poses_in_view, project


@pytest.fixture(scope="module")
def rig():
    return make_rig(distorted=False)


def from_either_end(found, expected):
    return min((found - expected, found[::-1] - expected), key=lambda error: np.abs(error).mean())


def test_corners_are_found_within_a_seventh_of_a_pixel(rig):
    X = poses_in_view(rig, 3, np.random.default_rng(0))
    for X_LBoard in X:
        found = find_corners(picture(rig.left, X_LBoard), BOARD)
        assert found is not None
        error = from_either_end(found, project(rig.left, X_LBoard))
        assert np.sqrt((error**2).sum(axis=1).mean()) < 0.14


def test_both_pictures_count_the_corners_from_the_same_end(rig):
    X_LBoard = poses_in_view(rig, 1, np.random.default_rng(1))[0]
    left, right = picture(rig.left, X_LBoard), picture(rig.right, rig.X_RL @ X_LBoard)
    shot = find_shot("a", left, right, BOARD)
    assert shot is not None
    left_error = shot.left - project(rig.left, X_LBoard)
    right_error = shot.right - project(rig.right, rig.X_RL @ X_LBoard)
    assert (np.abs(left_error).max() < 1) == (np.abs(right_error).max() < 1)
    np.testing.assert_array_equal(shot.half_turned().left[0], shot.left[-1])


@pytest.mark.parametrize("level", [0, 120, 255])
def test_no_board_is_found_where_none_is(level):
    empty = np.full((SIZE[1], SIZE[0]), level, np.uint8)
    assert find_corners(empty, BOARD) is None
    assert find_shot("a", empty, empty, BOARD) is None


@pytest.mark.parametrize(
    "wrong", [{"columns": 2}, {"rows": 0}, {"square": 0.0}, {"square": float("nan")}]
)
def test_boards_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        Board(**wrong)
