"""What both calibrations share: shots of a board on disk, and what a calibration of them leaves
behind.

A shot is `NAME_left.png` and `NAME_right.png`, or named otherwise (`camera/pairs.py`). Where a
robot held the board there is `poses.csv`, one row a shot (`vision/boards/poses_table.py`): the
flange's pose in the robot's base, as a UR controller states it while its tool centre point is set
to zero.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.figure import Figure

from breastscan.camera.grey import read_grey
from breastscan.camera.interface import StereoPair
from breastscan.camera.pairs import paired
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
    pictures: Mapping[str, tuple[Path, Path]]
    """Left and right, by the shot's name."""
    left_out: Mapping[str, str]
    """Names of the others, and why."""

    def pair(self, name: str) -> StereoPair:
        """Both pictures of a shot, as 8-bit grey."""
        return _read(self.pictures[name])


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


def read_shots(folder: Path, board: Board) -> ShotFolder:
    """Find the board's corners in every shot of a folder; its pictures are named as
    `camera.pairs.paired` has it.

    Raises:
        CalibrationError: The folder holds no shots, they differ in size, or the board is never
            found.
        PerceptionError: There is no folder, or a picture is damaged.
    """
    there = paired(folder)
    if not there.pairs:
        raise CalibrationError(
            f"no shots in {folder}: expected pairs NAME_left.png and NAME_right.png", folder
        )
    found: list[BoardShot] = []
    left_out = {str(path.relative_to(folder)): "no partner" for path in there.alone}
    size = None
    for name, paths in there.pairs.items():
        pair = _read(paths)
        size = size or pair.left.shape
        for path, picture in zip(paths, (pair.left, pair.right), strict=True):
            if picture.shape != size:
                raise CalibrationError(
                    f"{path} is {picture.shape[1]}x{picture.shape[0]} px, the others are "
                    f"{size[1]}x{size[0]} px: take all shots with one camera setting",
                    picture.shape,
                )
        shot = find_shot(name, pair.left, pair.right, board)
        if shot is None:
            left_out[name] = "board not found in both pictures"
        elif same := next((other.name for other in found if other.is_like(shot)), None):
            left_out[name] = f"the same as {same}"
        else:
            found.append(shot)
    if not found:
        raise CalibrationError(
            f"none of the {len(there.pairs)} shots in {folder} shows a board of {board.columns} x "
            f"{board.rows} inner corners in both pictures: check the board's numbers, the light "
            "and the focus",
            folder,
        )
    assert size is not None
    return ShotFolder(
        shots=tuple(found), size=(size[1], size[0]), pictures=there.pairs, left_out=left_out
    )


def _read(paths: tuple[Path, Path]) -> StereoPair:
    left, right = (read_grey(path) for path in paths)
    return StereoPair(left=left, right=right, time=0.0)


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
    *,
    of_shots: Mapping[str, Float[np.ndarray, "shots"]] = {},
    warnings: Sequence[str] = (),
) -> None:
    """Write `rig.yaml`, with what speaks against it, `metrics.json`, the figures, and
    `residuals.csv`: a row a shot, with what else is known of it and the reason if left out.
    """
    result.rig.save(folder / RIG_FILE, warnings)
    writing.write_json(folder / "metrics.json", metrics)
    for name, figure in figures.items():
        write_png(figure, folder / f"{name}.png")
    left_out = {**result.dropped, **found.left_out}
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
