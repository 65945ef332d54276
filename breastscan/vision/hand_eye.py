"""Where the cameras stand in the robot's base, from a board held by the flange [Zhang, Sec. V-A,
Eq. 32, Figs. 16, 17].

Eye-to-hand: the loop `X_BF X_FBoard = X_BL X_LBoard` closes at every pose of the arm. A solution in
closed form at which most poses agree starts a joint least squares on the corners in both pictures.
It also gives each stated flange pose the slack that the arm's repeatability leaves, adjusts the
cameras' relative pose (which mends the depth where the board was, should the rig have a yaw error)
and measures the board's squares by the arm. Poses that do not fit the others are left out by name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.boards import pose_mistakes
from breastscan.vision.boards.arm_fit import ArmFit, fit
from breastscan.vision.boards.arm_loop import (
    CLOSED_FORMS,
    Loop,
    closed_form,
    gaps,
    most_agreed,
    tilt_spread,
)
from breastscan.vision.calibration import board_pose
from breastscan.vision.camera import StereoRig

FEWEST_POSES = 10
"""Thirty are advisable."""
LEAST_SHARE = 0.75
"""Of the poses that must fit one another [-]."""
MIN_TILT = np.radians(8.0)
"""Spread of the flange's rotations about the second of their axes, one sigma [rad]: +-30 deg give
12."""
LARGEST_DISAGREEMENT = 0.02
"""Distance between the camera's places from both closed forms [m]."""
LARGEST_REPROJECTION_PX = 1.0
LARGEST_SQUARE_ERROR = 0.003
LARGEST_BASELINE_ERROR = 0.005
LARGEST_FOCAL_ERROR = 0.005
"""By which the board's squares, the baseline and the focal lengths as the arm measures them may
depart from what is stated [-]."""
LARGEST_SIGMA, LARGEST_SIGMA_ANGLE = 4e-4, np.radians(0.04)
"""Of the cameras' place, one sigma of its distance and of its angle from the truth [m, rad]."""
LARGEST_HELD_OUT, LARGEST_HELD_OUT_ANGLE = 1.2e-3, np.radians(0.2)
"""By which the loop may stay open at poses that were not used, RMS [m, rad]."""
OUTLIER_RATIO = 4.0
OUTLIER_SIGMAS, OUTLIER_PX = 8.0, 0.3
"""A pose is left out when its slack or its residual exceeds the median one so many times [-], and
so many sigmas or so much [px]."""


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
    held_out: tuple[float, float]
    """By how much the loop stays open at poses that a calibration with every other one has not
    seen, RMS: distance [m] and angle [rad]."""
    square: float
    """Side of the board's squares as the arm measures it [m]."""
    focal_px: float
    """Focal length of the left camera as the arm measures it [px]."""
    slack: Float[np.ndarray, "shots"]
    """By how much each stated pose was moved, RMS over its six numbers, in sigmas [-]."""
    covariance: Float[np.ndarray, "6 6"]
    """Of the error of `X_BL`, as rotation vector [rad] and translation [m] in the left camera's
    frame."""
    residuals_px: Float[np.ndarray, "shots 2"]
    """RMS distance between found and predicted corners of each shot, left and right [px]."""
    X_BF: Float[np.ndarray, "shots 4 4"]
    """The flange at each shot that was used, as stated [m]."""
    shots: tuple[BoardShot, ...]
    """Those that were used, their corners counted from the same end of the board."""
    dropped: dict[str, str]
    """Names of the shots that were not used, and why."""

    @property
    def reprojection_px(self) -> float:
        """RMS distance between found and predicted corners over all pictures [px]."""
        return float(np.sqrt(np.mean(self.residuals_px**2)))

    @property
    def sigma(self) -> tuple[float, float]:
        """One sigma of the distance [m] and of the angle [rad] between `X_BL` and the truth."""
        variances = np.diag(self.covariance)
        return float(np.sqrt(variances[3:].sum())), float(np.sqrt(variances[:3].sum()))


def hand_eye(
    shots: Sequence[BoardShot],
    X_BF: Float[np.ndarray, "shots 4 4"],
    rig: StereoRig,
    board: Board,
    readings: Mapping[str, Float[np.ndarray, "shots 4 4"]] | None = None,
) -> HandEye:
    """The cameras' pose in the base, from the flange's pose at each shot of the board it holds.

    Cameras that ride on the flange before a board that stands still are the same task with base
    and flange exchanged: give `X_FB`, and `X_BL` is the camera in the flange.

    Args:
        shots: Corners of the board; from which of its ends they are counted does not matter.
        X_BF: Flange poses at the same shots [m].
        rig: The calibrated cameras.
        board: The board.
        readings: What the stated numbers were, had they been written in other ways: to name a
            mistake.

    Raises:
        CalibrationError: Too few poses, too little tilt, poses that do not belong to the shots, or
            a result that is not trusted.
    """
    if len(shots) < FEWEST_POSES:
        raise _too_few(len(shots), {})
    spread = tilt_spread(X_BF)
    if spread < MIN_TILT:
        raise CalibrationError(
            f"the flange's rotations vary by {np.degrees(spread):.1f} deg about their second axis, "
            f"{np.degrees(MIN_TILT):.0f} deg are needed: tilt the board by +-30 deg about "
            "several axes",
            spread,
        )
    loop = most_agreed(shots, X_BF, rig, board)
    if loop.share < LEAST_SHARE:
        raise _unfit(shots, X_BF, rig, board, readings or {}, loop)
    dropped = {
        shot.name: "its pose does not fit the others'"
        for shot, closed in zip(shots, loop.closed, strict=True)
        if not closed
    }
    used = np.flatnonzero(loop.closed)
    starts = [
        closed_form(X_BF[used], loop.X_LBoard[used], method) for method in CLOSED_FORMS.values()
    ]
    while True:
        if len(used) < max(FEWEST_POSES, LEAST_SHARE * len(shots)):
            raise _too_few(len(used), dropped)
        X_FBoard = se3.inverse(X_BF[used[0]]) @ loop.X_BL @ loop.X_LBoard[used[0]]
        of_used = [loop.shots[k] for k in used], X_BF[used], rig, board, loop.X_BL, X_FBoard
        fitted = fit(*of_used)
        outlier = _outlier(fitted)
        if outlier is None:
            break
        moved = _rms(fitted.slack)[outlier]
        dropped[shots[used[outlier]].name] = (
            f"outlier, its pose {moved:.0f} sigmas off, reprojection error "
            f"{fitted.residuals_px[outlier].max():.2f} px"
        )
        used = np.delete(used, outlier)
    asked = fit(*of_used, lengths=True)
    result = HandEye(
        rig=fitted.rig,
        X_FBoard=fitted.X_FBoard,
        tilt_spread=spread,
        disagreement=_between(*starts),
        held_out=_held_out(loop, used, X_BF, rig, board, fitted),
        square=board.square * asked.scale,
        focal_px=float(asked.rig.left.K[0, 0]),
        slack=_rms(fitted.slack),
        covariance=fitted.covariance,
        residuals_px=fitted.residuals_px,
        X_BF=X_BF[used],
        shots=tuple(loop.shots[k] for k in used),
        dropped=dropped,
    )
    _check(result, rig, board)
    return result


def _outlier(fitted: ArmFit) -> int | None:
    """The pose that stands out most, if one does."""
    worst = []
    for value, least in ((_rms(fitted.slack), OUTLIER_SIGMAS),
                         (fitted.residuals_px.max(axis=1), OUTLIER_PX)):  # fmt: skip
        worst.append(value / max(OUTLIER_RATIO * float(np.median(value)), least))
    exceeding = np.max(worst, axis=0)
    return int(exceeding.argmax()) if exceeding.max() > 1.0 else None


def _held_out(
    loop: Loop,
    used: np.ndarray,
    X_BF: Float[np.ndarray, "n 4 4"],
    rig: StereoRig,
    board: Board,
    fitted: ArmFit,
) -> tuple[float, float]:
    """Each half of the poses as a calibration with the other half predicts it."""
    assert fitted.rig.X_BL is not None
    open_by = []
    for seen, unseen in ((used[::2], used[1::2]), (used[1::2], used[::2])):
        half = fit(
            [loop.shots[k] for k in seen], X_BF[seen], rig, board, fitted.rig.X_BL, fitted.X_FBoard
        )
        assert half.rig.X_BL is not None
        measured = replace(board, square=board.square * half.scale)
        X_LBoard = [board_pose(half.rig, loop.shots[k], measured) for k in unseen]
        open_by.append(gaps(half.rig.X_BL, half.X_FBoard, X_BF[unseen], np.array(X_LBoard)))
    squared = np.concatenate(open_by) ** 2
    return (
        float(np.sqrt(squared[:, 3:].sum(axis=1).mean())),
        float(np.sqrt(squared[:, :3].sum(axis=1).mean())),
    )


def _check(result: HandEye, rig: StereoRig, board: Board) -> None:
    """Pass when the result is to be trusted."""
    (distance, angle), (open_by, turned) = result.sigma, result.held_out
    baseline, focal = result.rig.baseline, result.focal_px
    stated_square, stated_baseline = board.square * 1e3, rig.baseline * 1e3
    refused = {
        f"{' and '.join(CLOSED_FORMS)} place the camera {result.disagreement[0] * 1e3:.0f} mm "
        f"apart, at most {LARGEST_DISAGREEMENT * 1e3:.0f} mm are accepted: do the poses belong to "
        "these shots, in this order?": result.disagreement[0] > LARGEST_DISAGREEMENT,
        f"measured by the arm, the board's squares are {result.square * 1e3:.2f} mm, not "
        f"{stated_square:g} mm: measure them over ten squares and give --board.square in metres, "
        "here and in `calibrate`": abs(np.log(result.square / board.square)) > LARGEST_SQUARE_ERROR,
        f"measured by the arm, the left camera's focal length is {focal:.1f} px, by the rig file "
        f"{rig.left.K[0, 0]:.1f} px: is it the file of these cameras, and was neither zoom nor "
        "focus turned?": abs(np.log(focal / rig.left.K[0, 0])) > LARGEST_FOCAL_ERROR,
        f"measured by the arm, the cameras stand {baseline * 1e3:.2f} mm apart, by the rig file "
        f"{stated_baseline:.2f} mm: is it the file of these cameras, calibrated with the right "
        "size of squares?": abs(np.log(baseline / rig.baseline)) > LARGEST_BASELINE_ERROR,
        f"the corners depart from the fitted poses by {result.reprojection_px:.2f} px, at most "
        f"{LARGEST_REPROJECTION_PX} px are accepted: did the board or a camera move in "
        "between?": result.reprojection_px > LARGEST_REPROJECTION_PX,
        f"the cameras' place is known to {distance * 1e3:.2f} mm and {np.degrees(angle):.3f} deg, "
        f"one sigma, at most {LARGEST_SIGMA * 1e3:g} mm and {np.degrees(LARGEST_SIGMA_ANGLE):.2f} "
        f"deg are accepted (the stated poses had to be moved by "
        f"{float(np.median(result.slack)):.0f} sigmas, as a median): is it the rig file of these "
        "cameras, does the board sit firmly, are the arm's kinematics calibrated? More poses "
        "help": distance > LARGEST_SIGMA or angle > LARGEST_SIGMA_ANGLE,
        f"a calibration with every other pose predicts the rest to {open_by * 1e3:.2f} mm and "
        f"{np.degrees(turned):.3f} deg, at most {LARGEST_HELD_OUT * 1e3:g} mm and "
        f"{np.degrees(LARGEST_HELD_OUT_ANGLE):.1f} deg are accepted: did the board slip, a camera "
        "move, are the arm's kinematics calibrated?": open_by > LARGEST_HELD_OUT
        or turned > LARGEST_HELD_OUT_ANGLE,
    }
    for reason, applies in refused.items():
        if applies:
            raise CalibrationError(reason, result)


def _unfit(
    shots: Sequence[BoardShot],
    X_BF: Float[np.ndarray, "n 4 4"],
    rig: StereoRig,
    board: Board,
    readings: Mapping[str, Float[np.ndarray, "n 4 4"]],
    loop: Loop,
) -> CalibrationError:
    """Why poses do not fit the shots, as far as that can be told."""
    cause = pose_mistakes.named(shots, X_BF, rig, board, readings)
    cause = cause or (
        "do they belong to these shots, in this order, and were board and cameras firm? One file "
        "for each shot, written as it is taken, keeps them together"
    )
    return CalibrationError(
        f"{loop.closed.sum()} of {len(shots)} poses fit one another: {cause}", loop.closed
    )


def _too_few(count: int, dropped: dict[str, str]) -> CalibrationError:
    because = "" if not dropped else f" (left out: {', '.join(dropped)})"
    return CalibrationError(
        f"{count} poses with the board in both pictures that fit one another{because}, at least "
        f"{FEWEST_POSES} and {LEAST_SHARE:.0%} of all are needed: take 30",
        count,
    )


def _rms(slack: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
    return np.sqrt(np.mean(slack**2, axis=1))


def _between(
    first: Float[np.ndarray, "4 4"], second: Float[np.ndarray, "4 4"]
) -> tuple[float, float]:
    """Distance between two poses [m] and angle [rad]."""
    between = se3.inverse(first) @ second
    return float(np.linalg.norm(between[:3, 3])), float(
        np.linalg.norm(se3.rotation_vector(between))
    )
