"""`breastscan calibrate`: from pictures of a board to a rig file, its residuals and its figures.

The twin shows how well that finds its own cameras: its pictures land on disk and are calibrated
from there, like those of real cameras.
"""

from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure

from breastscan.checks import require_seed
from breastscan.commands import shots as files
from breastscan.commands.console import Out, Seed, twin_imports
from breastscan.report import calibration_figures as draw
from breastscan.run.writing import staged, write_settings
from breastscan.vision import calibration
from breastscan.vision.board import Board
from breastscan.vision.calibration import Calibration
from breastscan.vision.rigs.writing import write_camera_info


def calibrate(
    shots: tyro.conf.Positional[Path | None] = None,
    /,
    twin: bool = False,
    out: Out = Path("out/calibrate"),
    seed: Seed = 0,
    board: Board = Board(),  # noqa: B008 (frozen)
) -> None:
    """Calibrate a pair of cameras from shots of a chessboard.

    Args:
        shots: Folder of NAME_left.png and NAME_right.png, 30 pairs or so.
        twin: Whether to render the shots with the twin's cameras instead, and compare with the
            truth.
        out: Folder for rig.yaml, both camera_info files, residuals.csv, metrics.json,
            config.json and figures.
        seed: Seed of the twin's shots.
        board: The board.

    Raises:
        CalibrationError: The shots are missing, do not fit together, or do not determine the
            cameras.
        PerceptionError: A picture cannot be read.
        ConfigError: There is not one source of shots, or `out` cannot be written.
    """
    require_seed(seed)
    files.need_one_source(shots, twin, seed)
    with staged(out) as folder:
        shown = None
        if shots is None:
            with twin_imports():
                from sim.cameras.shown_board import ShownBoard
            shown = ShownBoard(board, seed)
        for name, pair in shown or ():
            files.write_shot(folder, name, pair)
        found = files.read_shots(shots or folder, board)
        result = calibration.calibrate(found.shots, found.size, board)
        metrics = _metrics(result) | (shown.scene.errors_of(result.rig) if shown else {})
        write_camera_info(folder, result.rig)
        files.write_results(folder, found, result, _figures(shots or folder, result), metrics)
        write_settings(folder, {"twin": twin, "seed": seed, "board": board})
    files.tell_results(out, metrics)


def _metrics(result: Calibration) -> dict[str, object]:
    """What a calibration says of itself."""
    quality = result.quality
    return {
        "calibration_reprojection_px": result.reprojection_px,
        "calibration_held_out_px": quality.held_out_px,
        "calibration_coverage": list(quality.coverage),
        "calibration_tilt_spread_deg": float(np.degrees(quality.tilt_spread)),
        "calibration_shots": len(result.shots),
        "calibration_dropped": sorted(result.dropped),
    }


def _figures(folder: Path, result: Calibration) -> dict[str, Figure]:
    shot, rig = result.shots[0], result.rig
    pair = files.read_pair(folder, shot.name)
    after = rig.rectify(pair.left, pair.right)
    return {
        "corners": draw.corners(
            (pair.left, pair.right), (shot.left, shot.right), ("Left", "Right")
        ),
        "residuals": draw.residual_bars([shot.name for shot in result.shots], result.residuals_px),
        "boards": draw.board_places(result.X_LBoard, result.board.points, rig.X_RL),
        "rectified": draw.rectified((pair.left, pair.right), (after.left, after.right)),
    }
