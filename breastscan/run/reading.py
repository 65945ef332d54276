"""A run folder, read once into a frozen value."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars
import trimesh
from jaxtyping import Float, UInt8

from breastscan.errors import ConfigError
from breastscan.run.columns import Trajectory

REQUIRED_FILES = (
    "metrics.json", "config.json", "left.png", "right.png", "disparity.png", "cloud.ply", "path.csv",
    "trajectory.parquet",
)  # fmt: skip
"""What `breastscan scan` always writes; a video only where there is a scene to film."""

VIDEO_FILE = "scan.mp4"
PATH_COLUMNS = ("x_m", "y_m", "z_m", "nx", "ny", "nz")


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

    @staticmethod
    def load(folder: Path) -> "Run":
        """Read a run folder.

        Raises:
            ConfigError: A file is missing or cannot be read.
        """
        _require_files(folder)
        path = _read_path(folder / "path.csv")
        return Run(
            metrics=_read_json(folder / "metrics.json"),
            config=_read_json(folder / "config.json"),
            left=_read_image(folder / "left.png"),
            right=_read_image(folder / "right.png"),
            disparity=_read_image(folder / "disparity.png"),
            cloud_B=_read_cloud(folder / "cloud.ply"),
            path_B=path[:, :3],
            normals_B=path[:, 3:],
            trajectory=Trajectory.load(folder / "trajectory.parquet"),
            has_video=(folder / VIDEO_FILE).is_file(),
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
    return ConfigError(f"{path} cannot be read ({reason}): run `breastscan scan --out {path.parent}` again", path)


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


def _read_cloud(path: Path) -> Float[np.ndarray, "n 3"]:
    try:
        cloud = trimesh.load(path)
    except (ValueError, IndexError, KeyError) as error:
        raise _unreadable(path, f"not a PLY file: {error}") from error
    if not isinstance(cloud, trimesh.PointCloud | trimesh.Trimesh):
        raise _unreadable(path, f"expected points, got a {type(cloud).__name__}")
    return np.asarray(cloud.vertices, dtype=float)


def _read_path(path: Path) -> Float[np.ndarray, "k 6"]:
    try:
        return polars.read_csv(path).select(PATH_COLUMNS).cast(polars.Float64).to_numpy()
    except polars.exceptions.PolarsError as error:
        raise _unreadable(path, f"expected the columns {', '.join(PATH_COLUMNS)}: {error}") from error
