"""The loop that arm, board and cameras close at every pose, `X_BF X_FBoard = X_BL X_LBoard`: its
solutions in closed form, and the poses at which it does close.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.calibration import board_pose
from breastscan.vision.camera import StereoRig

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
CLOSED_FORMS = {"Park": cv2.CALIB_HAND_EYE_PARK, "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS}
DRAWS = 200
"""Threes of poses of which a solution is tried: with a third of all poses wrong, three in ten
draws have none of them."""
GAP, GAP_ANGLE = 0.01, np.radians(1.0)
"""By how much the loop may stay open at a pose that belongs to the others [m, rad]."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """What closes the loop at most of the poses."""

    shots: tuple[BoardShot, ...]
    """Their corners counted from the same end of the board."""
    X_LBoard: Float[np.ndarray, "shots 4 4"]
    X_BL: Float[np.ndarray, "4 4"]
    closed: Bool[np.ndarray, "shots"]
    """At which poses it does."""

    @property
    def share(self) -> float:
        """Of the poses, at which the loop closes [-]."""
        return float(self.closed.mean())


def tilt_spread(X_BF: Float[np.ndarray, "n 4 4"]) -> float:
    """Spread of the flange's rotations about the second of their principal axes, one sigma [rad].

    Rotations about one axis alone leave the camera's place along it open.
    """
    rotations = Rotation.from_matrix(X_BF[:, :3, :3])
    rotation_vectors = (rotations.mean().inv() * rotations).as_rotvec()
    return float(np.sqrt(max(np.linalg.eigvalsh(np.cov(rotation_vectors.T))[1], 0.0)))


def closed_form(
    X_BF: Float[np.ndarray, "n 4 4"], X_LBoard: Float[np.ndarray, "n 4 4"], method: int
) -> Float[np.ndarray, "4 4"]:
    """`X_BL` [m] by one of OpenCV's methods, which calls the flange `gripper` and expects the
    camera on it.

    With the camera fixed and the board on the flange, base and flange change places. Where the
    method's matrix is not a rotation, the nearest one; where it finds none, the identity.
    """
    X_FB = se3.inverse(X_BF)
    rotations_and_translations: Any = [
        part for X in (X_FB, X_LBoard) for part in (X[:, :3, :3], X[:, :3, 3])
    ]
    R, p = cv2.calibrateHandEye(*rotations_and_translations, method=method)
    if not np.isfinite(R).all():
        return np.eye(4)
    U, _, Vt = np.linalg.svd(R)
    return se3.pose(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt, p.reshape(3))


def most_agreed(
    shots: Sequence[BoardShot], X_BF: Float[np.ndarray, "shots 4 4"], rig: StereoRig, board: Board
) -> Loop:
    """The closed form of three poses that closes the loop at most others, by random draws."""
    shots = same_end(shots, X_BF, rig, board)
    X_LBoard = np.array([board_pose(rig, shot, board) for shot in shots])
    rng, best = np.random.default_rng(0), (np.inf, np.eye(4), np.zeros(len(shots), bool))
    for _ in range(DRAWS):
        three = rng.choice(len(shots), 3, replace=False)
        X_BL = closed_form(X_BF[three], X_LBoard[three], CLOSED_FORMS["Park"])
        open_by = _gaps(X_BL, X_BF, X_LBoard, three)
        cost = np.minimum(open_by, 1.0).sum()
        if cost < best[0]:
            best = cost, X_BL, open_by < 1.0
    _, X_BL, closed = best
    return Loop(shots=tuple(shots), X_LBoard=X_LBoard, X_BL=X_BL, closed=closed)


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


def gaps(
    X_BL: Float[np.ndarray, "4 4"],
    X_FBoard: Float[np.ndarray, "4 4"],
    X_BF: Float[np.ndarray, "n 4 4"],
    X_LBoard: Float[np.ndarray, "n 4 4"],
) -> Float[np.ndarray, "n 6"]:
    """By how much the loop stays open at each pose: where the cameras see the board, against where
    the arm says that it is, as rotation vector and translation in the board's frame [rad, m].
    """
    between = se3.inverse(X_BF @ X_FBoard) @ X_BL @ X_LBoard
    return np.concatenate([se3.rotation_vector(between), between[:, :3, 3]], axis=1)


def _gaps(
    X_BL: Float[np.ndarray, "4 4"],
    X_BF: Float[np.ndarray, "n 4 4"],
    X_LBoard: Float[np.ndarray, "n 4 4"],
    three: np.ndarray,
) -> Float[np.ndarray, "n"]:
    """Each gap in shares of what may be, the board held as three poses say on the average."""
    held = se3.inverse(X_BF[three]) @ X_BL @ X_LBoard[three]
    R = Rotation.from_matrix(held[:, :3, :3]).mean().as_matrix()
    open_by = gaps(X_BL, se3.pose(R, held[:, :3, 3].mean(axis=0)), X_BF, X_LBoard)
    return np.maximum(
        np.linalg.norm(open_by[:, :3], axis=1) / GAP_ANGLE,
        np.linalg.norm(open_by[:, 3:], axis=1) / GAP,
    )


def _relative_angles(
    first: Float[np.ndarray, "n 3 3"], second: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n n"]:
    """Angle between each rotation of the first set and each of the second [rad]."""
    trace = np.einsum("aij,bij->ab", first, second)
    return np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))
