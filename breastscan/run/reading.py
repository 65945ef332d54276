"""A run folder, read once into a frozen value."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars
from jaxtyping import Float, UInt8

from breastscan.errors import ConfigError, PlanningError
from breastscan.run.clouds import read_cloud
from breastscan.run.columns import PATH, STROKE, names
from breastscan.run.skin_map import MAP_FILE, SkinMap
from breastscan.run.trajectory import LOG_FILE, Trajectory

REQUIRED_FILES = (
    "metrics.json",
    "config.json",
    "left.png",
    "right.png",
    "disparity.png",
    "cloud.ply",
    "path.csv",
    "trajectory.parquet",
)
"""What `breastscan scan` always writes; a video only where there is a scene to film."""

VIDEO_FILE = "scan.mp4"
OPTIONAL_FILES = (VIDEO_FILE, MAP_FILE)
"""What only some scans write."""
UNIT_TOLERANCE = 0.01
"""How far the length of a normal may be from 1: rounded files."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Everything a report shows of one scan."""

    metrics: dict[str, Any]
    """What was measured, units in the names."""
    config: dict[str, Any]
    """Settings, versions and seed, nested."""
    left: UInt8[np.ndarray, "h w 3"]
    right: UInt8[np.ndarray, "h w 3"]
    """The raw pair, BGR as OpenCV reads it."""
    disparity: UInt8[np.ndarray, "h2 w2 3"]
    """Colour-mapped disparity of the rectified pair, BGR."""
    cloud_B: Float[np.ndarray, "n 3"]
    """Reconstructed points in B [m]."""
    path_B: Float[np.ndarray, "k 3"]
    """Points of the planned path in B [m]."""
    normals_B: Float[np.ndarray, "k 3"]
    """Outward unit normals at `path_B`."""
    trajectory: Trajectory
    has_video: bool
    """Whether a film lies beside the page."""
    skin_map: SkinMap | None
    """Which skin an examination has touched; None for a single loop, or where it is not known."""

    @staticmethod
    def load(folder: Path) -> "Run":
        """Read a run folder.

        Raises:
            ConfigError: A file is missing or cannot be read.
        """
        _require_files(folder)
        points_B, normals_B = read_path(folder / "path.csv", several=True)
        return Run(
            metrics=_read_json(folder / "metrics.json"),
            config=_read_json(folder / "config.json"),
            left=_read_image(folder / "left.png"),
            right=_read_image(folder / "right.png"),
            disparity=_read_image(folder / "disparity.png"),
            cloud_B=read_cloud(folder / "cloud.ply").points,
            path_B=points_B,
            normals_B=normals_B,
            trajectory=Trajectory.load(folder / LOG_FILE),
            has_video=(folder / VIDEO_FILE).is_file(),
            skin_map=_read_map(folder / MAP_FILE),
        )


def _require_files(folder: Path) -> None:
    missing = [name for name in REQUIRED_FILES if not (folder / name).is_file()]
    if missing:
        raise ConfigError(
            f"{folder} lacks {', '.join(missing)}: expected the folder of a finished scan; "
            f"run `breastscan scan --out {folder}`, or give another folder",
            missing,
        )


def _unreadable(path: Path, reason: object) -> ConfigError:
    return ConfigError(
        f"{path} cannot be read ({reason}): run `breastscan scan --out {path.parent}` again", path
    )


def _read_map(path: Path) -> SkinMap | None:
    try:
        return SkinMap.load(path) if path.is_file() else None
    except ValueError as error:
        raise _unreadable(path, error) from error


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise _unreadable(path, error) from error
    if not isinstance(content, dict):
        raise _unreadable(path, f"expected a JSON object, got a {type(content).__name__}")
    return content


def _read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise _unreadable(path, "not a picture that OpenCV knows")
    return image.astype(np.uint8, copy=False)


def read_path(
    source: Path, *, several: bool = False
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """A path's points [m] and unit normals, as a scan leaves them in `path.csv`.

    Args:
        source: The file.
        several: Whether it may hold several strokes, one after the other.

    Raises:
        ConfigError: The file is missing, lacks a column, or holds several strokes.
        PlanningError: A number is not finite, or a normal is not of length 1.
    """
    _require_file(source)
    try:
        table = polars.read_csv(source)
    except polars.exceptions.PolarsError as error:
        raise ConfigError(f"{source} is not a CSV file ({error})", source) from error
    strokes = table[STROKE].n_unique() if STROKE in table.columns else 1
    if strokes > 1 and not several:
        raise ConfigError(
            f"{source} holds {strokes} strokes, between which the probe leaves the skin: expected "
            "one path, so take the rows of one of them",
            source,
        )
    needed = names(PATH)
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise ConfigError(
            f"{source} lacks the columns {', '.join(missing)}: expected {', '.join(needed)}",
            source,
        )
    values = table.select(polars.col(needed).cast(polars.Float64, strict=False)).to_numpy()
    points_B, normals_B = np.hsplit(values, 2)
    lengths = np.linalg.norm(normals_B, axis=1)
    bad = ~(np.isfinite(values).all(axis=1) & (np.abs(lengths - 1.0) < UNIT_TOLERANCE))
    if bad.any():
        row = int(np.argmax(bad))
        raise PlanningError(
            f"point {row + 1} of {source} is {values[row]}: expected finite numbers and a normal "
            "of length 1",
            values[row],
        )
    return points_B, normals_B / lengths[:, None]


def _require_file(source: Path) -> None:
    if not source.is_file():
        raise ConfigError(
            f"no file at {source}: expected a path (CSV), as a scan leaves it",
            source,
        )
