"""Both cameras, their relative pose and every place of the board together, by least squares on the
corners.

OpenCV's `stereoCalibrate` adjusts the same quantities, but stops well short of the optimum on
narrow valleys.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.camera import Intrinsics, StereoRig

FOCAL_AND_CENTRE = ([0, 1, 0, 1], [0, 1, 2, 2])
"""Where fx, fy, cx and cy stand in a camera matrix."""
LENS_PARAMETERS = 9
"""fx, fy, cx, cy [px] and the five coefficients of the distortion."""


def project(
    camera: Intrinsics, X_CBoard: Float[np.ndarray, "n 4 4"], board: Board
) -> Float[np.ndarray, "n corners 2"]:
    """Pixels of the board's corners at each of its poses."""
    points_C = board.points @ X_CBoard[:, :3, :3].swapaxes(1, 2) + X_CBoard[:, None, :3, 3]
    pixels, _ = cv2.projectPoints(
        points_C.reshape(-1, 3), np.zeros(3), np.zeros(3), camera.K, camera.distortion
    )
    return pixels.reshape(len(X_CBoard), -1, 2)


def reprojection(
    rig: StereoRig, X_LBoard: Float[np.ndarray, "n 4 4"], shots: Sequence[BoardShot], board: Board
) -> Float[np.ndarray, "n 2 corners 2"]:
    """Predicted minus found corners of each shot, left and right [px]."""
    predicted = project(rig.left, X_LBoard, board), project(rig.right, rig.X_RL @ X_LBoard, board)
    return np.stack(predicted, axis=1) - np.array([(shot.left, shot.right) for shot in shots])


def residuals(errors_px: Float[np.ndarray, "n 2 corners 2"]) -> Float[np.ndarray, "n 2"]:
    """RMS distance of the corners in each picture [px]."""
    return np.sqrt(np.mean(np.sum(errors_px**2, axis=-1), axis=-1))


def adjust(
    rig: StereoRig, X_LBoard: Float[np.ndarray, "n 4 4"], shots: Sequence[BoardShot], board: Board
) -> tuple[StereoRig, Float[np.ndarray, "n 4 4"]]:
    """The rig and the board's poses that fit the corners best, from a start near them."""

    def moved(x: Float[np.ndarray, "m"]) -> tuple[StereoRig, Float[np.ndarray, "n 4 4"]]:
        lenses, motions = (
            x[: 2 * LENS_PARAMETERS].reshape(2, -1),
            x[2 * LENS_PARAMETERS :].reshape(-1, 6),
        )
        small = se3.from_rotation_vector(motions[:, :3], motions[:, 3:])
        left, right = _lens(rig.left, lenses[0]), _lens(rig.right, lenses[1])
        return replace(rig, left=left, right=right, X_RL=rig.X_RL @ small[0]), X_LBoard @ small[1:]

    def errors(x: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        return reprojection(*moved(x), shots, board).ravel()

    start = np.zeros(2 * LENS_PARAMETERS + 6 * (1 + len(shots)))
    return moved(least_squares(errors, start, x_scale="jac", method="lm").x)


def _lens(camera: Intrinsics, change: Float[np.ndarray, "9"]) -> Intrinsics:
    """The camera with its focal lengths and centre changed by a fraction of the focal length, its
    distortion by itself.
    """
    K = camera.K.copy()
    K[FOCAL_AND_CENTRE] += camera.K[0, 0] * change[:4]
    return replace(camera, K=K, distortion=camera.distortion + change[4:])
