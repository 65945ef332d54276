"""Where the cameras stand in the robot's base, from a board held by the flange [Zhang, Sec. V-A,
Eq. 32, Figs. 16, 17].

Eye-to-hand: the loop `X_BF X_FBoard = X_BL X_LBoard` closes at every pose of the arm. Two closed
forms start a joint least squares on the corners in both pictures. It also gives each stated flange
pose the slack that the arm's repeatability leaves, and adjusts the cameras' relative pose: that
mends the depth where the board was, should the rig have a yaw error, and changes little where it
has none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.boards import bundle
from breastscan.vision.calibration import board_pose
from breastscan.vision.camera import StereoRig

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
CLOSED_FORMS = {"Park": cv2.CALIB_HAND_EYE_PARK, "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS}
FEWEST_POSES = 10
"""Thirty are advisable."""
MIN_TILT = np.radians(8.0)
"""Spread of the flange's rotations about the second of their axes, one sigma [rad]: +-30 deg give
12."""
POSITION_SIGMA, ROTATION_SIGMA = 5e-5, np.radians(0.01)
"""Errors of a stated flange pose, one sigma along and about each axis [m, rad]."""
CORNER_SIGMA_PX = 0.03
"""Error of a found corner, one sigma along each axis [px]."""
LARGEST_DISAGREEMENT = 0.02
"""Distance between the camera's places from both closed forms [m]."""
LARGEST_REPROJECTION_PX = 1.0


@dataclass(frozen=True, kw_only=True)
class HandEye:
    """The cameras' place, and how well it is known."""

    rig: StereoRig
    """The rig with `X_BL`, its `X_RL` adjusted."""
    X_FBoard: Float[np.ndarray, "4 4"]
    """How the flange holds the board [m]."""
    tilt_spread: float
    """Spread of the flange's rotations about the second of their axes, one sigma [rad]."""
    disagreement: tuple[float, float]
    """Between the two closed forms: distance [m] and angle [rad] of the camera's poses."""
    residuals_px: Float[np.ndarray, "shots 2"]
    """RMS distance between found and predicted corners of each shot, left and right [px]."""
    X_BF: Float[np.ndarray, "shots 4 4"]
    """The flange at each shot, as stated [m]."""
    shots: tuple[BoardShot, ...]
    """Their corners counted from the same end of the board."""

    @property
    def reprojection_px(self) -> float:
        """RMS distance between found and predicted corners over all pictures [px]."""
        return float(np.sqrt(np.mean(self.residuals_px**2)))


def hand_eye(
    shots: Sequence[BoardShot], X_BF: Float[np.ndarray, "shots 4 4"], rig: StereoRig, board: Board
) -> HandEye:
    """The cameras' pose in the base, from the flange's pose at each shot of the board it holds.

    Args:
        shots: Corners of the board; from which of its ends they are counted does not matter.
        X_BF: Flange poses at the same shots [m].
        rig: The calibrated cameras.
        board: The board.

    Raises:
        CalibrationError: Too few poses, too little tilt, or poses that do not belong to the shots.
    """
    if len(shots) < FEWEST_POSES:
        raise CalibrationError(
            f"{len(shots)} poses with the board in both pictures, at least {FEWEST_POSES} are "
            "needed: take 30",
            shots,
        )
    spread = tilt_spread(X_BF)
    if spread < MIN_TILT:
        raise CalibrationError(
            f"the flange's rotations vary by {np.degrees(spread):.1f} deg about their second axis, "
            f"{np.degrees(MIN_TILT):.0f} deg are needed: tilt the board by +-30 deg about "
            "several axes",
            spread,
        )
    shots = same_end(shots, X_BF, rig, board)
    X_LBoard = np.array([board_pose(rig, shot, board) for shot in shots])
    starts = [closed_form(X_BF, X_LBoard, method) for method in CLOSED_FORMS.values()]
    disagreement = _disagreement(*starts)
    if disagreement[0] > LARGEST_DISAGREEMENT:
        raise CalibrationError(
            f"{' and '.join(CLOSED_FORMS)} place the camera {disagreement[0] * 1e3:.0f} mm apart, "
            f"at most {LARGEST_DISAGREEMENT * 1e3:.0f} mm are accepted: do the poses belong to "
            "these shots, in this order, and is the tool centre point zero?",
            disagreement,
        )
    held = se3.inverse(X_BF[0]) @ starts[0] @ X_LBoard[0]  # from the first shot
    rig, X_FBoard, residuals_px = _solve_jointly(shots, X_BF, rig, board, starts[0], held)
    result = HandEye(
        rig=rig,
        X_FBoard=X_FBoard,
        tilt_spread=spread,
        disagreement=disagreement,
        residuals_px=residuals_px,
        X_BF=X_BF,
        shots=tuple(shots),
    )
    if result.reprojection_px > LARGEST_REPROJECTION_PX:
        raise CalibrationError(
            f"the corners depart from the fitted poses by {result.reprojection_px:.2f} px, at most "
            f"{LARGEST_REPROJECTION_PX} px are accepted: did the board or a camera move in "
            "between?",
            result.reprojection_px,
        )
    return result


def tilt_spread(X_BF: Float[np.ndarray, "n 4 4"]) -> float:
    """Spread of the flange's rotations about the second of their principal axes, one sigma [rad].

    Rotations about one axis alone leave the camera's place along it open.
    """
    rotations = Rotation.from_matrix(X_BF[:, :3, :3])
    rotation_vectors = (rotations.mean().inv() * rotations).as_rotvec()
    return float(np.sqrt(max(np.linalg.eigvalsh(np.cov(rotation_vectors.T))[1], 0.0)))


def same_end(
    shots: Sequence[BoardShot], X_BF: Float[np.ndarray, "shots 4 4"], rig: StereoRig, board: Board
) -> list[BoardShot]:
    """The shots with their corners counted from the same end of the board.

    One picture does not tell a board's ends apart, but between two shots the board rotated by the
    same angle as the flange. How much better each pair of shots fits with like than with unlike
    ends makes a matrix, and the signs of its leading eigenvector are the shots' ends.
    """
    R_LBoard = np.array([board_pose(rig, shot, board)[:3, :3] for shot in shots])
    flange = _relative_angles(X_BF[:, :3, :3], X_BF[:, :3, :3])
    alike = np.abs(_relative_angles(R_LBoard, R_LBoard) - flange)
    unlike = np.abs(_relative_angles(R_LBoard, R_LBoard @ HALF_TURN) - flange)
    half_turned = np.linalg.eigh(unlike - alike)[1][:, -1] < 0
    return [
        shot.half_turned() if flipped else shot
        for shot, flipped in zip(shots, half_turned, strict=True)
    ]


def closed_form(
    X_BF: Float[np.ndarray, "n 4 4"], X_LBoard: Float[np.ndarray, "n 4 4"], method: int
) -> Float[np.ndarray, "4 4"]:
    """`X_BL` [m] by one of OpenCV's methods, which calls the flange `gripper` and expects the
    camera on it.

    With the camera fixed and the board on the flange, base and flange change places.
    """
    X_FB = se3.inverse(X_BF)
    rotations_and_translations: Any = [
        part for X in (X_FB, X_LBoard) for part in (X[:, :3, :3], X[:, :3, 3])
    ]
    R, p = cv2.calibrateHandEye(*rotations_and_translations, method=method)
    return se3.pose(R, p.reshape(3))


def _solve_jointly(
    shots: Sequence[BoardShot],
    X_BF: Float[np.ndarray, "n 4 4"],
    rig: StereoRig,
    board: Board,
    X_BL: Float[np.ndarray, "4 4"],
    X_FBoard: Float[np.ndarray, "4 4"],
) -> tuple[StereoRig, Float[np.ndarray, "4 4"], Float[np.ndarray, "n 2"]]:
    """The joint least squares from a start: small motions of every pose, weighed by what is known
    of the errors.

    Returns:
        The rig in the base, how the board is held, and the residuals [px].
    """

    def moved(motions: Float[np.ndarray, "m 6"]) -> tuple[np.ndarray, ...]:
        """Both cameras, the board in the flange, and the flange at each shot, moved a little
        from where they were.
        """
        small = se3.from_rotation_vector(motions[:, :3], motions[:, 3:])
        return X_BL @ small[0], rig.X_RL @ small[1], X_FBoard @ small[2], X_BF @ small[3:]

    def errors_px(
        X_BL: np.ndarray, X_RL: np.ndarray, X_FBoard: np.ndarray, X_BF: np.ndarray
    ) -> Float[np.ndarray, "n 2 corners 2"]:
        return bundle.reprojection(
            replace(rig, X_RL=X_RL), se3.inverse(X_BL) @ X_BF @ X_FBoard, shots, board
        )

    def weighed(x: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        motions = x.reshape(-1, 6)
        return np.concatenate([
            errors_px(*moved(motions)).ravel() / CORNER_SIGMA_PX,
            motions[3:, :3].ravel() / ROTATION_SIGMA,
            motions[3:, 3:].ravel() / POSITION_SIGMA,
        ])  # fmt: skip

    best = least_squares(
        weighed, np.zeros(6 * (3 + len(X_BF))), method="lm", x_scale="jac"
    ).x.reshape(-1, 6)
    X_BL_best, X_RL, X_FBoard_best, _ = poses = moved(best)
    return (
        replace(rig, X_RL=X_RL, X_BL=X_BL_best),
        X_FBoard_best,
        bundle.residuals(errors_px(*poses)),
    )


def _relative_angles(
    first: Float[np.ndarray, "n 3 3"], second: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n n"]:
    """Angle between each rotation of the first set and each of the second [rad]."""
    trace = np.einsum("aij,bij->ab", first, second)
    return np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))


def _disagreement(
    first: Float[np.ndarray, "4 4"], second: Float[np.ndarray, "4 4"]
) -> tuple[float, float]:
    """Distance [m] between two poses and angle [rad]."""
    between = se3.inverse(first) @ second
    return float(np.linalg.norm(between[:3, 3])), float(
        np.linalg.norm(se3.rotation_vector(between))
    )
