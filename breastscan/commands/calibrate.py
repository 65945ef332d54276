"""Both calibrations on disk: from a folder of shots to a rig file, its residuals and its figures."""

from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from breastscan.commands import shots
from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.report import calibration_figures as draw
from breastscan.run import writing
from breastscan.vision.boards.board import Board, BoardShot
from breastscan.vision.calibration import Calibration, calibrate
from breastscan.vision.camera import StereoRig
from breastscan.vision.hand_eye import HandEye, hand_eye
from breastscan.vision.rigs.camera_info import write_camera_info

RIG_FILE = "rig.yaml"
METRICS_FILE = "metrics.json"
SHOWN_POSES = 4
"""Poses of a hand-eye calibration that are pictured."""


def calibrate_rig(folder: Path, out: Path, board: Board) -> dict[str, object]:
    """Calibrate the cameras from the shots in `folder`, and write rig, residuals, figures and metrics into `out`.

    Returns:
        The metrics, as in `metrics.json`.

    Raises:
        CalibrationError: The shots are missing, do not fit together, or do not determine the cameras.
        PerceptionError: A picture cannot be read.
        ConfigError: `out` cannot be written.
    """
    with writing.staged(out) as results:
        metrics = rig_metrics(rig_from_shots(folder, results, board))
        writing.write_json(results / METRICS_FILE, metrics)
    return metrics


def calibrate_hand_eye(folder: Path, out: Path, rig: StereoRig, board: Board) -> dict[str, object]:
    """Find the cameras' place in the robot's base from the shots and `poses.csv` in `folder`; write it into `out`.

    Returns:
        The metrics, as in `metrics.json`.

    Raises:
        CalibrationError: Shots or poses are missing, do not belong together, or do not determine the place.
        PerceptionError: A picture cannot be read.
        ConfigError: `out` cannot be written.
    """
    with writing.staged(out) as results:
        metrics = hand_eye_metrics(hand_eye_from_shots(folder, results, rig, board))
        writing.write_json(results / METRICS_FILE, metrics)
    return metrics


def rig_from_shots(folder: Path, results: Path, board: Board) -> Calibration:
    """Calibrate from the shots in `folder`; write everything but the metrics into the folder `results`."""
    found = shots.read_shots(folder, board)
    calibration = calibrate(found.shots, found.size, board)
    calibration.rig.save(results / RIG_FILE)
    write_camera_info(results, calibration.rig)
    left_out = calibration.dropped | dict.fromkeys(found.without_board, "board not found in both pictures")
    _write_residuals(results, calibration.shots, calibration.residuals_px, left_out)
    _write_rig_figures(folder, results, calibration)
    return calibration


def hand_eye_from_shots(folder: Path, results: Path, rig: StereoRig, board: Board) -> HandEye:
    """Hand-eye calibration from shots and poses in `folder`; write everything but the metrics into `results`."""
    X_BF = shots.read_poses(folder)
    found = shots.read_shots(folder, board)
    if found.size != (rig.left.width, rig.left.height):
        raise CalibrationError(
            f"the shots in {folder} are {found.size[0]}x{found.size[1]} px, the rig was calibrated for "
            f"{rig.left.width}x{rig.left.height} px: use the rig file of this camera setting",
            found.size,
        )
    without_pose = [shot.name for shot in found.shots if shot.name not in X_BF]
    if without_pose:
        raise CalibrationError(
            f"{folder / shots.POSES_FILE} has no row for {', '.join(without_pose)}: add it or remove the pictures",
            without_pose,
        )
    result = hand_eye(found.shots, np.stack([X_BF[shot.name] for shot in found.shots]), rig, board)
    result.rig.save(results / RIG_FILE)
    left_out = dict.fromkeys(found.without_board, "board not found in both pictures")
    _write_residuals(results, result.shots, result.residuals_px, left_out)
    _write_hand_eye_figures(folder, results, result, board)
    return result


def rig_metrics(calibration: Calibration) -> dict[str, object]:
    """What a calibration says of itself."""
    quality = calibration.quality
    return {
        "calibration_reprojection_px": calibration.reprojection_px,
        "calibration_held_out_px": quality.held_out_px,
        "calibration_coverage": list(quality.coverage),
        "calibration_tilt_spread_deg": float(np.degrees(quality.tilt_spread)),
        "calibration_shots": len(calibration.shots),
        "calibration_dropped": sorted(calibration.dropped),
    }


def hand_eye_metrics(result: HandEye) -> dict[str, object]:
    """What a hand-eye calibration says of itself."""
    distance, angle = result.disagreement
    return {
        "handeye_reprojection_px": result.reprojection_px,
        "handeye_disagreement_mm": distance * 1e3,
        "handeye_disagreement_deg": float(np.degrees(angle)),
        "handeye_tilt_spread_deg": float(np.degrees(result.tilt_spread)),
        "handeye_shots": len(result.shots),
    }


def _write_rig_figures(folder: Path, results: Path, calibration: Calibration) -> None:
    shot, rig = calibration.shots[0], calibration.rig
    pair = shots.read_pair(folder, shot.name)
    after = rig.rectify(pair.left, pair.right)
    figures = {
        "corners": draw.corners((pair.left, pair.right), (shot.left, shot.right), ("Left", "Right")),
        "residuals": draw.residual_bars([shot.name for shot in calibration.shots], calibration.residuals_px),
        "boards": draw.board_places(calibration.X_LBoard, calibration.board.points, rig.X_RL),
        "rectified": draw.rectified((pair.left, pair.right), (after.left, after.right)),
    }
    for name, figure in figures.items():
        draw.write_png(figure, results / f"{name}.png")


def _write_hand_eye_figures(folder: Path, results: Path, result: HandEye, board: Board) -> None:
    assert result.rig.X_BL is not None
    cameras = (result.rig.X_BL, result.rig.X_BL @ se3.inverse(result.rig.X_RL))
    some = result.shots[:: max(len(result.shots) // SHOWN_POSES, 1)][:SHOWN_POSES]
    pictures = [shots.read_pair(folder, shot.name).left for shot in some]
    figures = {
        "poses": draw.corners(pictures, [shot.left for shot in some], [f"Pose {shot.name}" for shot in some]),
        "residuals": draw.residual_bars([shot.name for shot in result.shots], result.residuals_px),
        "frames": draw.hand_eye_frames(result.X_BF, result.X_FBoard, cameras, board.points),
    }
    for name, figure in figures.items():
        draw.write_png(figure, results / f"{name}.png")


def _write_residuals(
    folder: Path, used: tuple[BoardShot, ...], residuals_px: Float[np.ndarray, "n 2"], left_out: dict[str, str]
) -> None:
    """`residuals.csv`: one row a shot, with the reason where it was left out."""
    rows = [(shot.name, left, right, "") for shot, (left, right) in zip(used, residuals_px.tolist(), strict=True)]
    rows += [(name, None, None, reason) for name, reason in left_out.items()]
    columns = {"name": pl.String, "left_px": pl.Float64, "right_px": pl.Float64, "left_out": pl.String}
    pl.DataFrame(sorted(rows), schema=columns, orient="row").write_csv(folder / "residuals.csv", float_precision=4)
