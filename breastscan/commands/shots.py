"""What both calibrations share: shots of a board on disk, and what a calibration of them leaves
behind.

A shot is `NAME_left.png` and `NAME_right.png`; TIFF, JPEG and BMP files do as well. Where a robot
held the board there is `poses.csv`, one row a shot (`vision/boards/poses_table.py`): the flange's
pose in the robot's base, as a UR controller states it while its tool centre point is set to zero.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.figure import Figure

from breastscan.camera.grey import SUFFIXES, read_grey
from breastscan.camera.interface import StereoPair
from breastscan.commands.console import console
from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry import se3
from breastscan.report.theme import write_png
from breastscan.run import writing
from breastscan.vision.board import Board, BoardShot, find_shot
from breastscan.vision.boards.poses_table import POSES_FILE
from breastscan.vision.calibration import Calibration
from breastscan.vision.hand_eye import HandEye

RIG_FILE = "rig.yaml"
POSE_COLUMNS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True, kw_only=True)
class ShotFolder:
    """What was found in a folder of shots."""

    shots: tuple[BoardShot, ...]
    """Those that show the whole board in both pictures."""
    size: tuple[int, int]
    """Width and height of every picture [px]."""
    without_board: tuple[str, ...]
    """Names of the others."""


def need_one_source(shots: Path | None, twin: bool, seed: int) -> None:
    """Pass when shots are given or to be taken, not both; a seed is for those that are taken.

    Raises:
        ConfigError: Both or neither, or a seed for shots that are given.
    """
    if shots is not None and seed != 0:
        raise ConfigError(f"--seed {seed} is for shots that --twin takes: leave it out", seed)
    if (shots is None) != twin:
        raise ConfigError(
            "give either a folder of shots or --twin, which takes them in the simulation", shots
        )


def write_shot(folder: Path, name: str, pair: StereoPair) -> None:
    """Write both pictures of a shot."""
    writing.write_image(folder / f"{name}_left.png", pair.left)
    writing.write_image(folder / f"{name}_right.png", pair.right)


def read_pair(folder: Path, name: str) -> StereoPair:
    """Both pictures of a shot, as 8-bit grey.

    Raises:
        PerceptionError: A picture is missing or damaged.
    """
    left, right = (read_grey(_picture(folder, name, side)) for side in ("left", "right"))
    return StereoPair(left=left, right=right, time=0.0)


def _picture(folder: Path, name: str, side: str) -> Path:
    """The file of one picture; where there is none, the one that was expected."""
    files = [folder / f"{name}_{side}{suffix}" for suffix in SUFFIXES]
    return next((file for file in files if file.is_file()), files[0])


def read_shots(folder: Path, board: Board) -> ShotFolder:
    """Find the board's corners in every shot of a folder.

    Raises:
        CalibrationError: The folder holds no shots, they differ in size, or the board is never
            found.
        PerceptionError: A picture is missing or damaged.
    """
    left = (path for path in folder.glob("*_left.*") if path.suffix in SUFFIXES)
    names = sorted({path.stem.removesuffix("_left") for path in left})
    if not names:
        raise CalibrationError(
            f"no shots in {folder}: expected pairs NAME_left.png and NAME_right.png", folder
        )
    found = []
    without_board = []
    size = None
    for name in names:
        pair = read_pair(folder, name)
        size = size or pair.left.shape
        for side, picture in (("left", pair.left), ("right", pair.right)):
            if picture.shape != size:
                raise CalibrationError(
                    f"{_picture(folder, name, side)} is {picture.shape[1]}x{picture.shape[0]} px, "
                    f"the others are {size[1]}x{size[0]} px: take all shots with one camera "
                    "setting",
                    picture.shape,
                )
        shot = find_shot(name, pair.left, pair.right, board)
        found.append(shot) if shot else without_board.append(name)
    if not found:
        raise CalibrationError(
            f"none of the {len(names)} shots in {folder} shows a board of {board.columns} x "
            f"{board.rows} inner corners in both pictures: check the board's numbers, the light "
            "and the focus",
            folder,
        )
    assert size is not None
    return ShotFolder(
        shots=tuple(found), size=(size[1], size[0]), without_board=tuple(without_board)
    )


def write_poses(folder: Path, X_BF: dict[str, Float[np.ndarray, "4 4"]]) -> None:
    """Write `poses.csv`: the flange's pose at each shot."""
    values = se3.pose_vector(np.stack(list(X_BF.values())))
    table = pl.DataFrame({"name": list(X_BF), **dict(zip(POSE_COLUMNS, values.T, strict=True))})
    writing.write_csv(folder / POSES_FILE, table)


def write_results(
    folder: Path,
    found: ShotFolder,
    result: Calibration | HandEye,
    figures: Mapping[str, Figure],
    metrics: dict[str, object],
    of_shots: Mapping[str, Float[np.ndarray, "shots"]] = {},
) -> None:
    """Write `rig.yaml`, `metrics.json`, the figures, and `residuals.csv`: a row a shot, with what
    else is known of it and the reason if left out.
    """
    result.rig.save(folder / RIG_FILE)
    writing.write_json(folder / "metrics.json", metrics)
    for name, figure in figures.items():
        write_png(figure, folder / f"{name}.png")
    left_out = {
        **result.dropped,
        **dict.fromkeys(found.without_board, "board not found in both pictures"),
    }
    table = pl.DataFrame(
        {"name": [shot.name for shot in result.shots],
         "left_px": result.residuals_px[:, 0], "right_px": result.residuals_px[:, 1], **of_shots},
    )  # fmt: skip
    others = pl.DataFrame({"name": list(left_out), "left_out": list(left_out.values())})
    table = pl.concat([table, others.cast(pl.String)], how="diagonal").sort("name")
    writing.write_csv(folder / "residuals.csv", table, digits=4)


def tell_results(out: Path, metrics: dict[str, object]) -> None:
    """One line a metric, and where the rig lies."""
    for name, value in metrics.items():
        shown = f"{value:.4f}" if isinstance(value, float) else value
        console.print(f"{name:<30} {shown}", highlight=False)
    console.print(f"Rig: {out / RIG_FILE}", soft_wrap=True)
