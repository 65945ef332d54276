"""Shots of a calibration board whose poses are known: corners by projection, and small pictures
of it.
"""

import cv2
import numpy as np

from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.camera import Intrinsics, StereoRig

BOARD = Board()
SIZE = (640, 512)
PIXELS_PER_SQUARE = 40
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def make_rig(distorted=True):
    """A pair about 100 mm apart, rotated towards each other, looking down from 650 mm above B's
    (500, 0, 0) mm.
    """
    side = np.array([1.0, -1.0]) if distorted else np.zeros(2)
    cameras = [
        Intrinsics(
            K=np.array([[340.0 + 2 * k, 0, 322 - k], [0, 341.0 + k, 257 + k], [0, 0, 1]]),
            distortion=side[k] * np.array([-0.07, 0.11, 5e-4, -8e-4, -0.03]),
            width=SIZE[0],
            height=SIZE[1],
        )
        for k in (0, 1)
    ]
    X_RL = se3.from_rotation_vector(np.array([0.012, 0.07, 0.006]), np.array([-0.1, 0.003, 0.002]))
    X_BL = se3.from_rotation_vector(np.array([2.2, -2.2, 0.05]), np.array([0.5, 0.05, 0.65]))
    return StereoRig(left=cameras[0], right=cameras[1], X_RL=X_RL, X_BL=X_BL)


def rotation_about(axis_angle):
    return se3.from_rotation_vector(np.asarray(axis_angle, float), np.zeros(3))


def project(camera, X_CBoard, board=BOARD):
    rotation, _ = cv2.Rodrigues(X_CBoard[:3, :3])
    return cv2.projectPoints(board.points, rotation, X_CBoard[:3, 3], camera.K, camera.distortion)[
        0
    ][:, 0]


def poses_in_view(rig, count, rng, tilt_deg=(20, 45), width_fraction=1.0):
    """`X_LBoard` all over the left image, as far as both cameras see the board."""
    poses = []
    while len(poses) < count:
        u, v = rng.uniform(-0.5, 0.5, 2) * width_fraction
        depth = rng.uniform(0.3, 0.45)
        centre = depth * np.array([u * SIZE[0] / 340, v * SIZE[1] / 340, 1.0])
        axis = len(poses) * GOLDEN_ANGLE
        tilt = np.radians(rng.uniform(*tilt_deg))
        X = se3.pose(np.eye(3), centre) @ rotation_about(
            tilt * np.array([np.cos(axis), np.sin(axis), 0])
        )
        X = X @ rotation_about([0, 0, rng.uniform(-0.4, 0.4)]) @ se3.pose(np.eye(3), -BOARD.centre)
        pixels = np.vstack([project(rig.left, X), project(rig.right, rig.X_RL @ X)])
        if ((pixels > 22) & (pixels < np.array(SIZE) - 22)).all():
            poses.append(X)
    return np.array(poses)


def shots_of(rig, X_LBoard, rng, noise_px=0.02):
    return [
        BoardShot(
            name=f"{number:02d}",
            left=project(rig.left, X) + noise_px * rng.standard_normal((35, 2)),
            right=project(rig.right, rig.X_RL @ X) + noise_px * rng.standard_normal((35, 2)),
        )
        for number, X in enumerate(X_LBoard)
    ]


def flange_poses(rig, X_FBoard, count, rng, tilt_deg=(15, 30)):
    """`X_BF` that show a held board, face up, from around the centre of the view."""
    poses = []
    for number in range(count):
        axis = number * GOLDEN_ANGLE
        tilt = np.radians(rng.uniform(*tilt_deg))
        place = np.array([0.5, 0.0, 0.2]) + rng.uniform(-0.04, 0.04, 3)
        tilted = rotation_about([0, np.pi, 0]) @ rotation_about(
            tilt * np.array([np.cos(axis), np.sin(axis), 0])
        )
        X_BBoard = (
            se3.pose(np.eye(3), place) @ tilted @ rotation_about([0, 0, rng.uniform(-0.4, 0.4)])
        )
        poses.append(X_BBoard @ se3.pose(np.eye(3), -BOARD.centre) @ se3.inverse(X_FBoard))
    return np.array(poses)


def picture(camera, X_CBoard, board=BOARD):
    """The board before grey, as a camera without distortion sees it."""
    columns, rows = board.columns + 3, board.rows + 3
    printed = np.full((rows, columns), 200, np.uint8)
    y, x = np.mgrid[1 : rows - 1, 1 : columns - 1]
    printed[1:-1, 1:-1] = np.where((x + y) % 2 == 0, 30, 200)
    printed = np.kron(printed, np.ones((PIXELS_PER_SQUARE, PIXELS_PER_SQUARE), np.uint8))
    metres = board.square / PIXELS_PER_SQUARE
    first = 2 * PIXELS_PER_SQUARE - 0.5
    to_board = np.array([[metres, 0, -first * metres], [0, metres, -first * metres], [0, 0, 1]])
    finer = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1.0]])
    homography = finer @ camera.K @ X_CBoard[:3][:, [0, 1, 3]] @ to_board
    drawn = cv2.warpPerspective(printed, homography, (4 * SIZE[0], 4 * SIZE[1]), borderValue=(120,))
    return cv2.resize(drawn, SIZE, interpolation=cv2.INTER_AREA)
