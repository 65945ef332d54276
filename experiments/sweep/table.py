"""The data set of a sweep: a row a run, one Parquet file that any reader of Parquet takes.

Columns: `run`, `design`, `seed`; what is varied, by its name; the metrics, lists by their elements;
`error`, `cause`, `picture`, `touched`, `refused`; `wall_s`, `cpu_s`; `version`, `commit`.
"""

import io
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars

from breastscan.errors import ConfigError
from breastscan.run.provenance import provenance
from breastscan.run.writing import as_json
from experiments.sweep.engine import RECORDS
from experiments.sweep.spec import Run, Spec

FORMAT = "1"
"""Of the data set; raised when a column changes its meaning."""
AXES = ("x", "y", "z")
LAST = (
    "error", "cause", "picture", "touched", "refused", "wall_s", "cpu_s", "version", "commit",
    "command",
)  # fmt: skip
"""Columns after the metrics."""


def collected(runs: Sequence[Run], folder: Path) -> polars.DataFrame:
    """The rows of all runs that have a record.

    Args:
        runs: Of the sweep.
        folder: Of the sweep.
    """
    rows: list[dict[str, Any]] = []
    for run in runs:
        path = folder / RECORDS / f"{run.number:06}.json"
        if path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            row = {"run": run.number, "design": run.design, "seed": run.seed, **run.varied}
            rows.append(row | _flat(record) | {"command": command(run)})
    frame = polars.DataFrame(rows, infer_schema_length=None, strict=False)
    last = [name for name in LAST if name in frame.columns]
    return frame.select([name for name in frame.columns if name not in last] + last)


def command(run: Run) -> str:
    """What a user types to see this run by itself."""
    settings = [f"--set={name}={value}" for name, value in run.settings.items()]
    return shlex.join(["breastscan", "scan", f"--seed={run.seed}", *settings])


def _flat(record: dict[str, Any]) -> dict[str, Any]:
    """Lists by their elements, stages by their names; the picture by its place in the sweep."""
    flat: dict[str, Any] = {}
    for name, value in record.items():
        if name == "stages":
            flat |= {f"wall_s_{stage}": seconds for stage, seconds in value.items()}
        elif name == "picture" and value is not None:
            flat[name] = f"{RECORDS}/{value}"
        elif isinstance(value, list):
            ends = AXES if len(value) == len(AXES) else range(1, len(value) + 1)
            flat |= {f"{name}_{end}": one for end, one in zip(ends, value, strict=True)}
        else:
            flat[name] = value
    return flat


def write(path: Path, frame: polars.DataFrame, spec: Spec, seed: int) -> None:
    """Write the data set, with what it is and where it comes from in its metadata."""
    known = provenance()
    told = {
        "format": FORMAT,
        "version": known["versions"]["breastscan"],
        "commit": known["commit"] or "",
        "varied": json.dumps(list(spec.vary)),
        "spec": json.dumps(as_json(spec)),
        "seed": str(seed),
    }
    whole = io.BytesIO()  # polars itself would not say of a full disk that it is full
    frame.write_parquet(whole, metadata=told)
    part = path.with_suffix(".part")
    part.write_bytes(whole.getvalue())
    part.replace(path)


def read(path: Path) -> tuple[polars.DataFrame, dict[str, Any]]:
    """A data set, and its metadata.

    Raises:
        ConfigError: The file is missing or no data set of a sweep, or of another version.
    """
    try:
        frame, told = polars.read_parquet(path), polars.read_parquet_metadata(path)
    except (polars.exceptions.PolarsError, OSError) as error:
        raise ConfigError(
            f"{path} is no Parquet file ({error}): expected the data set of a sweep", path
        ) from error
    if told.get("format") != FORMAT:
        raise ConfigError(
            f"{path} is no data set of a sweep in format {FORMAT}, got {told.get('format')}: run "
            "the study again with this version",
            path,
        )
    return frame, {**told, "varied": json.loads(told["varied"])}
