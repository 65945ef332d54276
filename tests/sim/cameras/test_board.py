from contextlib import closing

import numpy as np
import pytest

from breastscan.geometry import kinematics, se3
from breastscan.vision.board import Board, find_shot
from breastscan.vision.boards.bundle import reprojection
from sim.cameras.board import BoardScene, X_FBoard, seen_by_both
from sim.cameras.camera import SimStereoCamera
from sim.cameras.held_board import CLEARANCE, PoseConfig, joint_poses
from sim.cameras.shown_board import ShotConfig, board_poses
from sim.room.cell import walled_cell
from sim.scene import SceneConfig

BOARD = Board()


@pytest.fixture(scope="module")
def free():
    return BoardScene(SceneConfig(camera=ShotConfig().camera), BOARD, held=False)


def test_rendered_corners_lie_where_opencv_projects_them(free):
    X_LBoard = board_poses(free.rig, BOARD, ShotConfig(shots=2), np.random.default_rng(0))
    with closing(SimStereoCamera(free)) as camera:
        for X in X_LBoard:
            free.place_board(free.X_BL @ X)
            pair = camera.capture()
            shot = find_shot("a", pair.left, pair.right, BOARD)
            assert shot is not None
            errors = [
                reprojection(free.rig, X[None], [s], BOARD) for s in (shot, shot.half_turned())
            ]
            error_px = min(errors, key=lambda error: np.abs(error).mean())
            assert np.sqrt((error_px**2).sum(axis=-1).mean()) < 0.1


def test_the_shots_are_in_view_tilted_and_spread(free):
    X_LBoard = board_poses(free.rig, BOARD, ShotConfig(), np.random.default_rng(0))
    assert all(seen_by_both(free.rig, X, BOARD) for X in X_LBoard)
    assert np.linalg.norm(np.ptp(X_LBoard[:, :2, 3], axis=0)) > 0.3


def test_the_arm_reaches_every_pose_without_touching_anything():
    scene, config = BoardScene(SceneConfig(), BOARD, held=True), PoseConfig()
    q = joint_poses(scene, BOARD, config, np.random.default_rng(0))
    clearance = walled_cell(scene).clearance
    X_LBoard = se3.inverse(scene.X_BL) @ kinematics.forward(q) @ X_FBoard
    assert len(q) == config.poses
    assert all(seen_by_both(scene.rig, X, BOARD) for X in X_LBoard)
    assert min(clearance.closest(each).distance for each in q) > CLEARANCE
