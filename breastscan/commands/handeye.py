"""`breastscan handeye`: from pictures of a board on the flange to the cameras' place in the robot's
base.

The twin shows how well that is found with an arm that is not exact and an estimated rig: its
pictures and stated poses land on disk and are calibrated from there.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure

from breastscan.checks import require_seed
from breastscan.commands import shots as files
from breastscan.commands.console import Out, Seed, twin_imports
from breastscan.errors import CalibrationError
from breastscan.geometry import se3
from breastscan.report import calibration_figures as draw
from breastscan.run.writing import staged, write_json, write_settings
from breastscan.vision.board import Board
from breastscan.vision.boards import poses_table
from breastscan.vision.boards.poses_table import StatedPoses
from breastscan.vision.camera import StereoRig
from breastscan.vision.hand_eye import HandEye, hand_eye

SHOWN_POSES = 4
"""Poses that are pictured."""


def handeye(
    shots: tyro.conf.Positional[Path | None] = None,
    /,
    *,
    rig: Path,
    on_flange: bool = False,
    twin: bool = False,
    out: Out = Path("out/handeye"),
    seed: Seed = 0,
    board: Board = Board(),  # noqa: B008 (frozen)
) -> None:
    """Find where calibrated cameras stand in the robot's base, from shots of a chessboard that the
    flange holds.

    Args:
        shots: Folder of NAME_left.png, NAME_right.png and poses.csv (name, x_m, y_m, z_m, rx_rad,
            ry_rad, rz_rad; docs/calibration.md has the other ways to write poses).
        rig: The rig file of the cameras, from `calibrate`.
        on_flange: Whether it is the cameras that ride on the flange, and the board that stands
            still: then the left camera's pose in the flange is found.
        twin: Whether to take the shots with the twin instead, and compare with the truth.
        out: Folder for rig.yaml, residuals.csv, metrics.json,
            config.json and figures.
        seed: Seed of the twin's poses and errors.
        board: The board.

    Raises:
        CalibrationError: Rig, shots or poses are missing, do not belong together, or do not
            determine the place.
        PerceptionError: A picture cannot be read.
        ConfigError: There is not one source of shots, or `out` cannot be written.
    """
    require_seed(seed)
    files.need_one_source(shots, twin, seed)
    cameras, held = StereoRig.load(rig), None
    with staged(out) as folder:
        if shots is None:
            with twin_imports():
                from sim.cameras.held_board import HeldBoard
            held = HeldBoard(board, seed)
        stated = {}
        for name, pair, X_BF in held or ():
            files.write_shot(folder, name, pair)
            stated[name] = X_BF
        if stated:
            files.write_poses(folder, stated)
        source = shots or folder
        poses, found = poses_table.read(source), files.read_shots(source, board)
        _need_fitting(source, found, poses, cameras)
        rows = [poses.row_of(shot.name) for shot in found.shots]
        of_shots = se3.inverse if on_flange else np.asarray
        result = hand_eye(
            found.shots,
            of_shots(poses.X_BF[rows]),
            cameras,
            board,
            {name: of_shots(X[rows]) for name, X in poses.readings.items()},
        )
        metrics = _metrics(result) | (held.scene.errors_of(result.rig) if held else {})
        figures = _figures(found, result, board, on_flange)
        if on_flange:
            result = _unplaced(folder, result)
        files.write_results(
            folder, found, result, figures, metrics, of_shots={"slack_sigmas": result.slack}
        )
        write_json(
            folder / "covariance.json",
            {"of": "left camera, rotation [rad] then translation [m] in its own frame",
             "covariance": result.covariance.tolist()},
        )  # fmt: skip
        write_settings(
            folder,
            {"rig": rig, "on_flange": on_flange, "twin": twin, "seed": seed, "board": board},
        )
    files.tell_results(out, metrics)


def _unplaced(folder: Path, result: HandEye) -> HandEye:
    """The cameras without a place in the base, which changes with the flange; that in the flange is
    written beside them.
    """
    assert result.rig.X_BL is not None
    write_json(folder / "on_flange.json", {"X_FL": result.rig.X_BL.tolist()})
    return replace(result, rig=replace(result.rig, X_BL=None))


def _need_fitting(
    folder: Path, found: files.ShotFolder, poses: StatedPoses, rig: StereoRig
) -> None:
    """Pass when the shots are of the rig's size, and each has its pose."""
    if found.size != (rig.left.width, rig.left.height):
        raise CalibrationError(
            f"the shots in {folder} are {found.size[0]}x{found.size[1]} px, the rig was calibrated "
            f"for {rig.left.width}x{rig.left.height} px: use the rig file of this camera setting",
            found.size,
        )
    without_pose = [shot.name for shot in found.shots if shot.name not in poses]
    if without_pose:
        raise CalibrationError(
            f"{folder / poses_table.POSES_FILE} has no row for {', '.join(without_pose)}: add it "
            "or remove the pictures",
            without_pose,
        )


def _metrics(result: HandEye) -> dict[str, object]:
    """What a hand-eye calibration says of itself."""
    pairs = {
        "sigma": result.sigma,
        "held_out": result.held_out,
        "disagreement": result.disagreement,
    }
    return {
        "handeye_reprojection_px": result.reprojection_px,
        **{f"handeye_{name}_mm": distance * 1e3 for name, (distance, _) in pairs.items()},
        **{f"handeye_{name}_deg": float(np.degrees(angle)) for name, (_, angle) in pairs.items()},
        "handeye_slack_sigmas": float(np.median(result.slack)),
        "handeye_square_mm": result.square * 1e3,
        "handeye_baseline_mm": result.rig.baseline * 1e3,
        "handeye_tilt_spread_deg": float(np.degrees(result.tilt_spread)),
        "handeye_shots": len(result.shots),
        "handeye_dropped": sorted(result.dropped),
    }


def _figures(
    found: files.ShotFolder, result: HandEye, board: Board, on_flange: bool
) -> dict[str, Figure]:
    """Corners, residuals, and the frames where the base's is the common one."""
    assert result.rig.X_BL is not None
    cameras = (result.rig.X_BL, result.rig.X_BL @ se3.inverse(result.rig.X_RL))
    some = result.shots[:: max(len(result.shots) // SHOWN_POSES, 1)][:SHOWN_POSES]
    pictures = [found.pair(shot.name).left for shot in some]
    frames = draw.hand_eye_frames(result.X_BF, result.X_FBoard, cameras, board.points)
    return {
        **({} if on_flange else {"frames": frames}),
        "poses": draw.corners(
            pictures, [shot.left for shot in some], [f"Pose {shot.name}" for shot in some]
        ),
        "residuals": draw.residual_bars([shot.name for shot in result.shots], result.residuals_px),
    }
