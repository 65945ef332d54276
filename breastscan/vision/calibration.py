"""The stereo rig from shots of a board: each camera alone, then the pair [Zhang, Sec. II-A, Figs.
2-5, Tables 1, 2].

Shots whose corners do not fit those of the others are named, dropped, and the calibration is
repeated, as in the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.boards import bundle
from breastscan.vision.boards.calibration_quality import (
    Quality,
    QualityLimits,
    complaints,
    image_coverage,
    tilt_spread,
)
from breastscan.vision.camera import Intrinsics, StereoRig

Lens = Literal[4, 5, 8, 12, 14]
"""Coefficients of the distortion, in OpenCV's order [-]."""
HELD_OUT_EVERY = 5
"""One shot in so many is held out of a second calibration, and then predicted by it."""
FEWEST_SHOTS = 12
"""That may remain."""
OUTLIER_RATIO, OUTLIER_PX = 4.0, 0.05
"""A shot is an outlier when its residual exceeds the median one so many times [-], and so much
[px]."""
MISPAIRED_RATIO, MISPAIRED = 6.0, 0.01
"""Its pictures are not of one instant when the right camera's place, as they give it, is off the
median place by so many times the median of the others' distances [-], and so far [m]."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A calibrated pair of cameras, and what there is to say about it."""

    rig: StereoRig
    board: Board
    shots: tuple[BoardShot, ...]
    """Those that were used."""
    residuals_px: Float[np.ndarray, "shots 2"]
    """RMS distance between found and predicted corners of each used shot, left and right [px]."""
    X_LBoard: Float[np.ndarray, "shots 4 4"]
    """Where the board was [m]."""
    dropped: dict[str, str]
    """Names of the shots that were not used, and why."""
    quality: Quality
    warnings: tuple[str, ...]
    """What it does not reach, where that was accepted."""

    @property
    def reprojection_px(self) -> float:
        """RMS distance between found and predicted corners over all pictures [px]."""
        return float(np.sqrt(np.mean(self.residuals_px**2)))


def calibrate(
    shots: Sequence[BoardShot],
    size: tuple[int, int],
    board: Board,
    limits: QualityLimits = QualityLimits(),  # noqa: B008 (frozen)
    *,
    lens: Lens = 5,
    accept: bool = False,
) -> Calibration:
    """Both cameras and their relative pose, without hand-eye.

    Args:
        shots: The board's corners in both pictures of each shot.
        size: Width and height of the pictures [px].
        board: The board.
        limits: What the set has to reach.
        lens: How many coefficients the distortion has.
        accept: Whether a set that does not is taken all the same, with its warnings.

    Raises:
        CalibrationError: Too few shots fit together, left and right are swapped, or the set is too
            poor to trust.
    """
    used, dropped = list(shots), {}
    while True:
        if len(used) < FEWEST_SHOTS:
            raise CalibrationError(
                f"{len(used)} usable shots of the board, at least {FEWEST_SHOTS} are "
                f"needed{_because(dropped)}: take more, with the whole board in both pictures",
                dropped,
            )
        alone = _each_alone(used, size, board, lens)
        mispaired = _mispaired(alone)
        for shot in [used[k] for k in mispaired]:
            dropped[shot.name] = "left and right are not of one instant"
            used.remove(shot)
        if mispaired:
            continue
        rig, X_LBoard, residuals_px = _estimate(alone, used, size, board)
        outlier = _outlier(residuals_px)
        if outlier is None:
            break
        worst = residuals_px[outlier].max()
        dropped[used.pop(outlier).name] = f"outlier, reprojection error {worst:.2f} px"
    _check_sides(rig)
    quality = Quality(
        coverage=image_coverage(used, size),
        tilt_spread=tilt_spread(X_LBoard),
        held_out_px=_held_out_px(used, size, board, lens),
        fit_px=float(np.sqrt(np.mean(residuals_px**2))),
    )
    warnings = tuple(complaints(quality, limits))
    if warnings and not accept:
        raise CalibrationError(f"{warnings[0]}. `--accept` takes the set all the same", quality)
    return Calibration(
        rig=rig,
        board=board,
        shots=tuple(used),
        residuals_px=residuals_px,
        X_LBoard=X_LBoard,
        dropped=dropped,
        quality=quality,
        warnings=warnings,
    )


def board_pose(rig: StereoRig, shot: BoardShot, board: Board) -> Float[np.ndarray, "4 4"]:
    """`X_LBoard` [m] of one shot, from the corners that both pictures give in space."""
    normalised = [
        cv2.undistortPoints(pixels[:, None], camera.K, camera.distortion)[:, 0].T
        for pixels, camera in ((shot.left, rig.left), (shot.right, rig.right))
    ]
    homogeneous = cv2.triangulatePoints(np.eye(3, 4), rig.X_RL[:3], *normalised)
    return fit_pose(board.points, (homogeneous[:3] / homogeneous[3]).T)


def fit_pose(
    p_B: Float[np.ndarray, "n 3"], p_A: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "4 4"]:
    """The `X_AB` that carries points given in B onto the same points given in A, by least
    squares [m].
    """
    centre_A, centre_B = p_A.mean(axis=0), p_B.mean(axis=0)
    U, _, Vt = np.linalg.svd((p_A - centre_A).T @ (p_B - centre_B))
    R_AB = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return se3.pose(R_AB, centre_A - R_AB @ centre_B)


@dataclass(frozen=True)
class _Alone:
    """What each camera says by itself."""

    cameras: tuple[Intrinsics, Intrinsics]
    X_CBoard: tuple[Float[np.ndarray, "shots 4 4"], Float[np.ndarray, "shots 4 4"]]
    """Where the board was, in the left and in the right camera [m]."""


def _each_alone(
    shots: Sequence[BoardShot], size: tuple[int, int], board: Board, lens: Lens
) -> _Alone:
    """Each camera by itself."""
    objects = [board.points.astype(np.float32)] * len(shots)
    cameras, places = [], []
    for side in ("left", "right"):
        pixels = [getattr(shot, side).astype(np.float32) for shot in shots]
        # larger lenses from what a usual one gives: from nothing they bend the picture's rim anyhow
        _, K, distortion, turns, moves = cv2.calibrateCamera(
            objects, pixels, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3 * (lens == 4)
        )
        coefficients = np.pad(distortion.ravel(), (0, 9))[:lens]
        cameras.append(Intrinsics(K=K, distortion=coefficients, width=size[0], height=size[1]))
        turned, moved = (np.array(values).reshape(-1, 3) for values in (turns, moves))
        places.append(se3.from_rotation_vector(turned, moved))
    return _Alone((cameras[0], cameras[1]), (places[0], places[1]))


def _mispaired(alone: _Alone) -> list[int]:
    """Shots whose two pictures place the right camera elsewhere than most do: found out before they
    are fitted together, which takes long where one does not belong.
    """
    X_LBoard, X_RBoard = alone.X_CBoard
    X_LR = X_LBoard @ se3.inverse(X_RBoard)
    away = np.linalg.norm(X_LR[:, :3, 3] - np.median(X_LR[:, :3, 3], axis=0), axis=1)
    limit = max(MISPAIRED_RATIO * float(np.median(away)), MISPAIRED)
    return np.flatnonzero(away > limit).tolist()


def _estimate(
    alone: _Alone, shots: Sequence[BoardShot], size: tuple[int, int], board: Board
) -> tuple[StereoRig, Float[np.ndarray, "shots 4 4"], Float[np.ndarray, "shots 2"]]:
    """The pair from what each camera says alone, then all together: the pair sharpens the
    intrinsics as well.

    Returns:
        The rig, the board's poses [m], and the residuals [px].
    """
    left, right = alone.cameras
    views = [
        [getattr(shot, side).astype(np.float32) for shot in shots] for side in ("left", "right")
    ]
    _, _, _, _, _, R, p, _, _ = cv2.stereoCalibrate(  # pyright: ignore[reportCallIssue]
        [board.points.astype(np.float32)] * len(shots),
        *views,
        left.K,
        left.distortion,
        right.K,
        right.distortion,
        size,
        flags=cv2.CALIB_FIX_INTRINSIC,
    )
    rig = StereoRig(left=left, right=right, X_RL=se3.pose(R, p.reshape(3)))
    X_LBoard = np.array([board_pose(rig, shot, board) for shot in shots])
    rig, X_LBoard = bundle.adjust(rig, X_LBoard, shots, board)
    return rig, X_LBoard, bundle.residuals(bundle.reprojection(rig, X_LBoard, shots, board))


def _outlier(residuals_px: Float[np.ndarray, "shots 2"]) -> int | None:
    """The worst shot, if it stands out."""
    of_shot = residuals_px.max(axis=1)
    worst = int(of_shot.argmax())
    limit_px = max(OUTLIER_RATIO * float(np.median(of_shot)), OUTLIER_PX)
    return worst if of_shot[worst] > limit_px else None


def _held_out_px(
    shots: Sequence[BoardShot], size: tuple[int, int], board: Board, lens: Lens
) -> float:
    """RMS distance between found and predicted corners of shots that a calibration has not seen
    [px].
    """
    kept = [shot for number, shot in enumerate(shots) if number % HELD_OUT_EVERY]
    rig, _, _ = _estimate(_each_alone(kept, size, board, lens), kept, size, board)
    held_out = shots[::HELD_OUT_EVERY]
    X_LBoard = np.array([board_pose(rig, shot, board) for shot in held_out])
    errors_px = bundle.reprojection(rig, X_LBoard, held_out, board)
    return float(np.sqrt(np.mean(bundle.residuals(errors_px) ** 2)))


def _check_sides(rig: StereoRig) -> None:
    if rig.X_RL[0, 3] > 0:
        raise CalibrationError(
            f"the left pictures were taken {rig.X_RL[0, 3] * 1e3:.0f} mm to the right of the right "
            "ones: left and right are swapped, exchange them",
            rig.X_RL,
        )


def _because(dropped: dict[str, str]) -> str:
    return (
        ""
        if not dropped
        else " (dropped: " + "; ".join(f"{name}, {why}" for name, why in dropped.items()) + ")"
    )
