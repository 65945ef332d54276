"""`breastscan calibrate`: from pictures of a board to a rig file, its residuals and its figures.

The twin shows how well that finds its own cameras: its pictures land on disk and are calibrated
from there, like those of real cameras.
"""

from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure
from rich.markup import escape

from breastscan.checks import require_seed
from breastscan.commands import shots as files
from breastscan.commands.console import Out, Seed, console, twin_imports
from breastscan.report import calibration_figures as draw
from breastscan.run.writing import staged, write_settings
from breastscan.vision import calibration
from breastscan.vision.board import Board
from breastscan.vision.boards.calibration_quality import QualityLimits
from breastscan.vision.calibration import Calibration, Lens
from breastscan.vision.rigs.writing import write_camera_info


def calibrate(
    shots: tyro.conf.Positional[Path | None] = None,
    /,
    twin: bool = False,
    out: Out = Path("out/calibrate"),
    seed: Seed = 0,
    board: Board = Board(),  # noqa: B008 (frozen)
    limits: QualityLimits = QualityLimits(),  # noqa: B008 (frozen)
    lens: Lens = 5,
    accept: bool = False,
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
        limits: What the shots have to reach for the calibration to be trusted.
        lens: Coefficients of the lenses' distortion: 4, 5, 8 (wide angles), 12 or 14 (tilted
            sensors).
        accept: Whether a calibration that does not reach them is written all the same, its warnings
            in its file.

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
        result = calibration.calibrate(
            found.shots, found.size, board, limits, lens=lens, accept=accept
        )
        metrics = _metrics(result) | (shown.scene.errors_of(result.rig) if shown else {})
        write_camera_info(folder, result.rig)
        files.write_results(
            folder, found, result, _figures(found, result), metrics, warnings=result.warnings
        )
        settings = {"twin": twin, "seed": seed, "board": board}
        write_settings(folder, {**settings, "limits": limits, "lens": lens, "accept": accept})
    files.tell_results(out, metrics)
    for warning in result.warnings:
        console.print(f"[yellow]Accepted in spite of this: {escape(warning)}[/]", soft_wrap=True)
    if not result.warnings:
        console.print("Good: all limits hold.")


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
        "calibration_baseline_mm": result.rig.baseline * 1e3,
        "calibration_focal_px": [float(c.K[0, 0]) for c in (result.rig.left, result.rig.right)],
        "calibration_warnings": list(result.warnings),
    }


def _figures(found: files.ShotFolder, result: Calibration) -> dict[str, Figure]:
    shot, rig = result.shots[0], result.rig
    pair = found.pair(shot.name)
    after = rig.rectify(pair.left, pair.right)
    return {
        "corners": draw.corners(
            (pair.left, pair.right), (shot.left, shot.right), ("Left", "Right")
        ),
        "residuals": draw.residual_bars([shot.name for shot in result.shots], result.residuals_px),
        "boards": draw.board_places(result.X_LBoard, result.board.points, rig.X_RL),
        "rectified": draw.rectified((pair.left, pair.right), (after.left, after.right)),
    }
