"""Both cameras, their relative pose and every place of the board together, by least squares on the
corners.

OpenCV's `stereoCalibrate` adjusts the same quantities, but stops well short of the optimum on
narrow valleys.
"""

from collections.abc import Callable, Sequence
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
EVALUATIONS = 60
"""At most: an adjustment takes about ten, and coefficients that hardly matter would go on for
ever."""
STEP = 1e-7
"""For derivatives by differences [rad, m, -]."""


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
    of_lenses = 2 * (4 + len(rig.left.distortion))  # focal lengths, centre, distortion
    shared = of_lenses + 6

    def moved(common: np.ndarray, of_poses: np.ndarray) -> tuple[StereoRig, np.ndarray]:
        lenses, of_right = common[:of_lenses].reshape(2, -1), common[None, of_lenses:]
        left, right = _lens(rig.left, lenses[0]), _lens(rig.right, lenses[1])
        X_RL = rig.X_RL @ motions(of_right)[0]
        return replace(rig, left=left, right=right, X_RL=X_RL), X_LBoard @ motions(of_poses)

    def errors_px(common: np.ndarray, of_poses: np.ndarray) -> np.ndarray:
        return reprojection(*moved(common, of_poses), shots, board)

    def parts(x: Float[np.ndarray, "m"]) -> tuple[np.ndarray, np.ndarray]:
        return x[:shared], x[shared:].reshape(-1, 6)

    best = least_squares(
        lambda x: errors_px(*parts(x)).ravel(),
        np.zeros(shared + 6 * len(shots)),
        lambda x: jacobian(errors_px, *parts(x)),  # pyright: ignore[reportArgumentType]
        x_scale="jac",
        method="lm",
        max_nfev=EVALUATIONS,
    )
    return moved(*parts(best.x))


def jacobian(
    errors_px: Callable[[np.ndarray, np.ndarray], np.ndarray],
    common: Float[np.ndarray, "m"],
    of_poses: Float[np.ndarray, "n 6"],
) -> Float[np.ndarray, "k p"]:
    """Derivatives of the corners' errors by differences. A pose moves the corners of its own shot
    alone, so one difference serves for the same motion of all of them: a tenth of the time.

    Args:
        errors_px: Errors of each shot, from the two below [px].
        common: Unknowns that all shots share.
        of_poses: Small motions of each shot's pose [rad, m].
    """
    here = errors_px(common, of_poses)
    poses, rows = len(of_poses), here[0].size
    J = np.zeros((here.size, len(common) + of_poses.size))
    for k, step in enumerate(STEP * np.eye(len(common))):
        J[:, k] = (errors_px(common + step, of_poses) - here).ravel()
    for k, step in enumerate(STEP * np.eye(6)):
        moved = (errors_px(common, of_poses + step) - here).reshape(poses, rows)
        for pose in range(poses):
            J[rows * pose : rows * (pose + 1), len(common) + 6 * pose + k] = moved[pose]
    return J / STEP


def motions(small: Float[np.ndarray, "m 6"]) -> Float[np.ndarray, "m 4 4"]:
    """Small motions [rad, m] as poses."""
    return se3.from_rotation_vector(small[:, :3], small[:, 3:])


def _lens(camera: Intrinsics, change: Float[np.ndarray, "k"]) -> Intrinsics:
    """The camera with its focal lengths and centre changed by a fraction of the focal length, its
    distortion by itself.
    """
    K = camera.K.copy()
    K[FOCAL_AND_CENTRE] += camera.K[0, 0] * change[:4]
    return replace(camera, K=K, distortion=camera.distortion + change[4:])
