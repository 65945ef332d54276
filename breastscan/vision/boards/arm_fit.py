"""Cameras, board and every pose of the arm together, by least squares on the corners, with some
slack for what the arm states [Zhang, Sec. V-A].
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.boards import bundle
from breastscan.vision.camera import StereoRig

POSITION_SIGMA, ROTATION_SIGMA = 5e-5, np.radians(0.01)
"""Errors of a stated flange pose, one sigma along and about each axis [m, rad]."""
CORNER_SIGMA_PX = 0.03
"""Error of a found corner, one sigma along each axis [px]."""
TRUSTED = np.array([5e-4, 1e-7])
"""Errors of the stated side of a square and of the rig's focal lengths, one sigma, as a share of
them [-]."""
ASKED = np.array([2e-3, 5e-4])
"""The same where it is asked whether they are right."""
COMMON = 20
"""Unknowns that all poses share: motions of the camera in the base, the right camera in it and the
board in the flange, and the scales of the board and of both focal lengths."""


@dataclass(frozen=True, kw_only=True)
class ArmFit:
    """What fits the corners best, and how well it is known."""

    rig: StereoRig
    """The rig with `X_BL`, its `X_RL` adjusted."""
    X_FBoard: Float[np.ndarray, "4 4"]
    """How the flange holds the board [m]."""
    scale: float
    """Side of the board's squares as the arm measures it, over the stated one [-]."""
    slack: Float[np.ndarray, "shots 6"]
    """By how much each stated pose was moved, rotation and position, in sigmas [-]."""
    residuals_px: Float[np.ndarray, "shots 2"]
    """RMS distance between found and predicted corners of each shot, left and right [px]."""
    covariance: Float[np.ndarray, "6 6"]
    """Of the error of `X_BL`, as rotation vector [rad] and translation [m] in the left camera's
    frame; as large as the residuals say, where these exceed the errors assumed."""


def fit(
    shots: Sequence[BoardShot],
    X_BF: Float[np.ndarray, "shots 4 4"],
    rig: StereoRig,
    board: Board,
    X_BL: Float[np.ndarray, "4 4"],
    X_FBoard: Float[np.ndarray, "4 4"],
    *,
    lengths: bool = False,
) -> ArmFit:
    """The joint least squares from a start: small motions of every pose, weighed by what is known
    of the errors.

    Args:
        shots: The board's corners.
        X_BF: Flange poses at the same shots [m].
        rig: The calibrated cameras.
        board: The board.
        X_BL: Where the left camera is, about [m].
        X_FBoard: How the flange holds the board, about [m].
        lengths: Whether it is asked if squares and focal lengths are right. Else they are trusted:
            a corner that is found a few hundredths of a pixel beside its place outweighs what
            little the arm knows of them.
    """
    poses = len(shots)
    scale_sigmas = ASKED if lengths else TRUSTED

    def errors_px(common: Float[np.ndarray, "m"], of_poses: Float[np.ndarray, "n 6"]) -> np.ndarray:
        small = bundle.motions(common[:18].reshape(3, 6))
        X_LBoard = (
            se3.inverse(X_BL @ small[0]) @ X_BF @ bundle.motions(of_poses) @ X_FBoard @ small[2]
        )
        scaled = replace(board, square=board.square * np.exp(common[18]))
        return bundle.reprojection(_adjusted(rig, small[1], common[19]), X_LBoard, shots, scaled)

    def weighed(x: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        common, of_poses = x[:COMMON], x[COMMON:].reshape(-1, 6)
        seen = errors_px(common, of_poses).ravel() / CORNER_SIGMA_PX
        return np.concatenate([seen, _slack(of_poses).ravel(), common[18:] / scale_sigmas])

    def jacobian(x: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k m"]:
        here = poses * shots[0].left.size * 2
        J = np.zeros((here + 6 * poses + 2, len(x)))
        J[:here] = bundle.jacobian(errors_px, x[:COMMON], x[COMMON:].reshape(-1, 6))
        J[:here] /= CORNER_SIGMA_PX
        J[here:-2, COMMON:] = np.diag(_slack(np.ones((poses, 6))).ravel())
        J[-2:, 18:COMMON] = np.diag(1 / scale_sigmas)
        return J

    best = least_squares(
        weighed,
        np.zeros(COMMON + 6 * poses),
        jacobian,  # pyright: ignore[reportArgumentType] (a callable is taken as well)
        method="lm",
        x_scale="jac",
    )
    common, of_poses = best.x[:COMMON], best.x[COMMON:].reshape(-1, 6)
    small = bundle.motions(common[:18].reshape(3, 6))
    freedom = best.fun.size - best.x.size
    excess = max(1.0, 2 * best.cost / freedom)
    return ArmFit(
        rig=replace(_adjusted(rig, small[1], common[19]), X_BL=X_BL @ small[0]),
        X_FBoard=X_FBoard @ small[2],
        scale=float(np.exp(common[18])),
        slack=_slack(of_poses),
        residuals_px=bundle.residuals(errors_px(common, of_poses)),
        covariance=excess * np.linalg.inv(best.jac.T @ best.jac)[:6, :6],
    )


def _adjusted(rig: StereoRig, of_right: Float[np.ndarray, "4 4"], log_focal: float) -> StereoRig:
    """The rig with its right camera moved, and both focal lengths scaled."""
    f = np.exp(log_focal)
    left, right = (
        replace(camera, K=camera.K * np.array([[f, f, 1.0], [1.0, f, 1.0], [1.0, 1.0, 1.0]]))
        for camera in (rig.left, rig.right)
    )
    return replace(rig, left=left, right=right, X_RL=rig.X_RL @ of_right)


def _slack(of_poses: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6"]:
    """Motions of stated poses in sigmas."""
    return of_poses / np.repeat([ROTATION_SIGMA, POSITION_SIGMA], 3)
