"""The run folder: everything a scan leaves behind, complete or not at all."""

import dataclasses
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import polars as pl
import trimesh
from jaxtyping import Float, Int
from trimesh.exchange.ply import export_ply

from breastscan.errors import ConfigError, notes_of
from breastscan.run.columns import PATH, STROKE, names
from breastscan.run.provenance import provenance
from breastscan.run.trajectory import LOG_FILE, Trajectory
from breastscan.run.unfinished import ABORTED

INNERMOST = re.compile(r"\[\n\s*([^\[\]{}\"]*)\n\s*\]")
"""A list of numbers as `json` indents it; text in a string holds no line break."""
STAGED = ".partial-"
"""How the names of folders begin in which results wait to be complete."""


@contextmanager
def staged(out: Path, optional: Sequence[str] = ()) -> Iterator[Path]:
    """Yield an empty folder whose files move into `out` when the block ends well, and vanish when
    it does not.

    Whatever an earlier run left in `out` stays whole until the new results are complete; only then
    goes what a scan that was cut off left in `ABORTED`.

    Args:
        out: Where the files are to be.
        optional: Names of files that not every run leaves: an earlier run's go, if this has none.

    Raises:
        ConfigError: `out` cannot be written; said before any work is done.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=STAGED, dir=out))
    except OSError as error:
        raise ConfigError(
            f"cannot write to the output folder {out} ({error.strerror}): choose another one with "
            "--out",
            out,
        ) from error
    try:
        yield folder
        for name in optional:
            if not (folder / name).exists():
                (out / name).unlink(missing_ok=True)
        for path in sorted(folder.iterdir()):
            os.replace(path, out / path.name)
        for scrap in (out / ABORTED, *out.glob(f"{STAGED}*")):  # a killed scan left its own
            shutil.rmtree(scrap, ignore_errors=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_json(path: Path, content: object) -> None:
    """Write JSON that any reader takes: arrays as lists, paths as strings, no NaN; a list of
    numbers on one line.
    """
    text = json.dumps(content, indent=2, default=_plain, allow_nan=False)
    text = INNERMOST.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    path.write_text(text + "\n", encoding="utf-8")


def require_writable(settings: dict[str, object]) -> None:
    """Accept settings that `config.json` can hold: before a scan, not at its end.

    Raises:
        ConfigError: One is infinite, or of a kind that JSON has not.
    """
    try:
        json.dumps(settings, default=_plain, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"a setting cannot be written to config.json ({error}): use finite numbers, and a "
            "force law whose fields are numbers and words",
            error,
        ) from error


def as_json(content: object) -> Any:
    """What a reader of written JSON gets."""
    return json.loads(json.dumps(content, default=_plain))


def write_settings(folder: Path, settings: dict[str, object]) -> None:
    """Write `config.json`: what a run was made with, and by what."""
    write_json(folder / "config.json", {**settings, **provenance()})


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot write a {type(value).__name__} as JSON")


def write_image(path: Path, image: np.ndarray) -> None:
    """Write a PNG, or a TIFF.

    Raises:
        OSError: The file could not be written.
    """
    path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())


def write_cloud(
    path: Path, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> None:
    """Write points [m] with their unit normals as binary PLY."""
    cloud = trimesh.Trimesh(vertices=points, vertex_normals=normals, process=False)
    path.write_bytes(export_ply(cloud, vertex_normal=True))


def write_path(
    path: Path,
    points_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    strokes: Int[np.ndarray, "n"] | None = None,
) -> None:
    """Write a path's points [m] and unit normals in B as CSV; of a scan of several strokes the
    stroke of each point too, in the column `STROKE`.
    """
    table = pl.DataFrame(dict(zip(names(PATH), np.hstack([points_B, normals_B]).T, strict=True)))
    if strokes is not None:
        table = table.with_columns(pl.Series(STROKE, strokes))
    write_csv(path, table, digits=7)


def write_csv(path: Path, table: pl.DataFrame, *, digits: int | None = None) -> None:
    """Write a table as CSV, with so many digits behind the point.

    Raises:
        OSError: The file could not be written; polars itself would not say that of a full disk.
    """
    path.write_text(table.write_csv(float_precision=digits), encoding="utf-8")


def write_aborted(out: Path, trajectory: Trajectory, error: BaseException) -> Path:
    """Save what was measured before a scan was cut off, beside the results of earlier runs.

    Args:
        out: The run folder.
        trajectory: The log until then.
        error: What ended the scan.

    Returns:
        The folder with `trajectory.parquet` and `abort.json`.
    """
    folder = out / ABORTED
    folder.mkdir(parents=True, exist_ok=True)
    trajectory.save(folder / LOG_FILE)
    on_path = trajectory.s[~np.isnan(trajectory.s)]
    reached = on_path.max() if on_path.size else None
    content = {
        "error": type(error).__name__,
        "message": str(error),
        "notes": notes_of(error),
        "path_reached_m": reached,
        **provenance(),
    }
    write_json(folder / "abort.json", content)
    return folder
