import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.vision.board import Board, find_corners, find_shot
from tests.vision.board_shots import (
    BOARD,
    SIZE,
    make_rig,
    picture,
    poses_in_view,
    project,
    rotation_about,
    shots_of,
)


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


@pytest.mark.parametrize(
    ("columns", "rows", "turns"),
    [(9, 6, 1), (6, 9, 1), (7, 5, 2), (8, 6, 2), (5, 5, 2), (6, 6, 4)],
)
def test_both_pictures_count_from_the_same_corner_however_the_board_is_held(
    rig, columns, rows, turns
):
    """Upright, on its side, upside down; a board whose ends differ always from the same one."""
    board, firsts = Board(columns=columns, rows=rows, square=0.015), []
    assert len(board.turns) == turns
    for roll in np.linspace(0.1, 0.1 + 1.5 * np.pi, 4):
        held = rotation_about([0.3, 0, 0]) @ rotation_about([0, 0, roll])
        X = se3.pose(np.eye(3), np.array([0.03, 0, 0.33])) @ held
        X_LBoard = X @ se3.pose(np.eye(3), -board.centre)
        views = ((rig.left, X_LBoard), (rig.right, rig.X_RL @ X_LBoard))
        shot = find_shot("a", *(picture(camera, X, board) for camera, X in views), board)
        first = [
            int(np.linalg.norm(project(camera, X, board) - corners[0], axis=1).argmin())
            for (camera, X), corners in zip(views, (shot.left, shot.right), strict=True)
        ]
        assert first[0] == first[1]
        firsts.append(first[0])
    if turns == 1:
        assert len(set(firsts)) == 1


def test_a_copied_picture_shows_the_same_and_another_one_does_not(rig):
    X = poses_in_view(rig, 1, np.random.default_rng(1))
    one, again, noisy = (
        shots_of(rig, X, np.random.default_rng(2), noise)[0] for noise in (0.0, 0.0, 0.03)
    )
    assert one.is_like(again)
    assert not one.is_like(noisy)


@pytest.mark.parametrize("level", [0, 120, 255])
def test_no_board_is_found_where_none_is(level):
    empty = np.full((SIZE[1], SIZE[0]), level, np.uint8)
    assert find_corners(empty, BOARD) is None
    assert find_shot("a", empty, empty, BOARD) is None


@pytest.mark.parametrize(
    "wrong",
    [{"columns": 2}, {"rows": 0}, {"square": 0.0}, {"square": float("nan")}, {"square": 20.0}],
)
def test_boards_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        Board(**wrong)
