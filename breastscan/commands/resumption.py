"""What a scan leaves on disk while the arm is on its way, and how another one goes on with it."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from breastscan import scan_log
from breastscan.camera.interface import StereoPair
from breastscan.cell import Cell
from breastscan.commands.console import console
from breastscan.commands.results import elsewhere
from breastscan.commands.settings import PROVENANCE
from breastscan.errors import ConfigError
from breastscan.robot.interface import Robot
from breastscan.run import journal
from breastscan.run.provenance import provenance
from breastscan.run.trajectory import Sample
from breastscan.run.unfinished import ABORTED, CELL_FILE, JOURNAL_FILE, PLAN_FILE, settings_file
from breastscan.run.writing import as_json, write_aborted, write_image, write_settings
from breastscan.scan import CutOff, Keep, ScanPlan
from breastscan.settings import flat

NAMED = 5
"""Most settings that an error names."""


def keep(
    out: Path,
    cell: Cell,
    settings: dict[str, Any],
    also: Callable[[Path], None] = lambda folder: None,
    *,
    explain: Callable[[BaseException], None] = lambda error: None,
) -> Keep:
    """What keeps a scan into `out` for `--resume`, beside earlier results.

    Args:
        out: The run folder.
        cell: Where robot and cameras stand.
        settings: All that the scan is made with.
        also: Saves into a folder what else is known when an error cuts the scan off.
        explain: Adds to the error, as notes, what else is known of it.
    """

    @contextmanager
    def kept(images: StereoPair, plan: ScanPlan, robot: Robot, log: list[Sample]) -> Iterator[None]:
        folder, earlier = out / ABORTED, len(log)
        if not log:
            _begin(folder, images, plan, robot, cell, settings)
        try:
            with journal.written(folder / JOURNAL_FILE, log):
                yield
        except BaseException as error:
            explain(error)
            if len(log) > earlier:
                trajectory = scan_log.trajectory(log, plan.motion, robot)
                try:
                    also(write_aborted(out, trajectory, error))
                except OSError:
                    folder = write_aborted(elsewhere(), trajectory, error)
                console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)
            console.print(f"To go on from there: breastscan scan --resume {out}", soft_wrap=True)
            raise

    return kept


def _begin(
    folder: Path,
    images: StereoPair,
    plan: ScanPlan,
    robot: Robot,
    cell: Cell,
    settings: dict[str, Any],
) -> None:
    """Write all but the log, in place of what an earlier scan left; the settings last."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    taken = np.format_float_positional(images.time, trim="0")
    write_image(folder / f"left_{taken}.png", images.left)
    write_image(folder / f"right_{taken}.png", images.right)
    np.savez(folder / PLAN_FILE, q=plan.motion.q, q_home=robot.state().q)
    cell.save(folder / CELL_FILE)
    (folder / JOURNAL_FILE).touch()
    write_settings(folder, settings)


def cut_off(out: Path, settings: dict[str, Any]) -> CutOff:
    """What a scan into `out` did until it was cut off.

    Args:
        out: Its run folder.
        settings: With which it is to go on, which must be its own.

    Raises:
        ConfigError: There is nothing to go on with, or a setting is another.
    """
    found = json.loads(settings_file(out).read_text(encoding="utf-8"))
    given = {"robot": None, **dict(flat(as_json(settings)))}
    other = [
        f"{name} was {value}, is {given[name]}"
        for name, value in {"robot": None, **dict(flat(found))}.items()
        if name not in PROVENANCE and name in given and given[name] != value
    ]
    if other:
        raise ConfigError(
            f"the scan in {out} goes on with its own settings only, and others are given: "
            f"{', '.join(other[:NAMED])}; leave them out",
            other,
        )
    _tell_version(out, found)
    folder = out / ABORTED
    with np.load(folder / PLAN_FILE) as plan:
        return CutOff(log=journal.read(folder / JOURNAL_FILE), q=plan["q"], q_home=plan["q_home"])


def _tell_version(out: Path, found: dict[str, Any]) -> None:
    """Tell whether another version began the scan; whether its plan is the same is seen later."""
    here = provenance()
    for name, then, now in (
        ("version", found["versions"].get("breastscan"), here["versions"]["breastscan"]),
        ("commit", found.get("commit"), here["commit"]),
    ):
        if then != now:
            told = f"The scan in {out} was begun by {name} {then}, and goes on with {now}."
            console.print(f"[yellow]{told}[/]", soft_wrap=True)
