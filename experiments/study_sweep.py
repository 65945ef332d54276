"""What does the twin's scan do when its settings vary? Any of them, over values or drawn."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import yaml

from breastscan.errors import ConfigError
from breastscan.run.provenance import provenance
from breastscan.run.writing import as_json, write_json
from experiments.sweep import page, table
from experiments.sweep.engine import Engine, carry_out
from experiments.sweep.scan_run import scan_run
from experiments.sweep.spec import Spec

SPEC_FILE = "spec.json"
"""What a folder's sweep is, so that no other goes on in it."""
Judge = Callable[[polars.DataFrame], polars.DataFrame]
"""Adds columns to a data set."""


def run(
    spec: Spec,
    out: Path,
    *,
    seed: int,
    engine: Engine,
    name: str = "sweep",
    judge: Judge = lambda frame: frame,
    told: Callable[[int], None] = lambda done: None,
) -> polars.DataFrame:
    """Scan with every choice of settings; what the folder holds already is not done again.

    Args:
        spec: What varies.
        out: Folder for the records, and NAME.parquet once all have run.
        seed: Of what is drawn.
        engine: What runs it.
        name: Of the study.
        judge: Says which scans went well, where that is more than to end without an error.
        told: Called with how many runs are done.

    Returns:
        The data set, a row a run.

    Raises:
        ConfigError: The spec cannot be, the folder holds another sweep, or the engine is gone.
    """
    runs = spec.runs(seed)
    _begin(out, spec, seed)
    carry_out(scan_run, runs, out, engine, told)
    frame = judge(table.collected(runs, out))
    data = out / f"{name}.parquet"
    table.write(data, frame, spec, seed)
    write_page(data, out)
    return frame


def write_page(data: Path, folder: Path) -> None:
    """Write the page of a data set into a folder.

    Raises:
        ConfigError: The file is none of a sweep.
    """
    frame, told = table.read(data)
    meta = page.Meta(
        title=f"Study: {data.stem}",
        varied=tuple(told["varied"]),
        version=told["version"],
        commit=told.get("commit"),
        spec=yaml.safe_dump(json.loads(told["spec"]), sort_keys=False),
        pictures=data.parent,
    )
    folder.mkdir(parents=True, exist_ok=True)
    page.write(frame, meta, folder)


def _begin(out: Path, spec: Spec, seed: int) -> None:
    """Note what the folder's sweep is.

    Raises:
        ConfigError: It is another, or was begun by another version, or nothing can be written.
    """
    path = out / SPEC_FILE
    version = provenance()["versions"]["breastscan"]
    own = as_json({"spec": spec, "seed": seed, "version": version})
    try:
        out.mkdir(parents=True, exist_ok=True)
        if not path.is_file():
            write_json(path, own)
            return
        there = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"cannot use the output folder {out} ({error}): choose another one with --out", out
        ) from error
    other = [key for key in own if there.get(key) != own[key]]
    if other:
        raise ConfigError(
            f"{out} holds a sweep with another {' and '.join(other)}: give its own to go on with "
            "it, or another --out",
            other,
        )
