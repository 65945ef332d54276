"""`breastscan study`: one question about the twin, answered by figures and tables."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import tyro

os.environ.setdefault("MUJOCO_GL", "egl")

from breastscan.checks import require_known, require_seed
from breastscan.commands.console import Out, Seed, console, progress_bars
from breastscan.commands.settings import require_used
from breastscan.errors import ConfigError
from experiments import (
    study_budget,
    study_cameras,
    study_force,
    study_joints,
    study_paper,
    study_phantom,
    study_population,
    study_sweep,
    study_twin,
    study_weights,
)
from experiments.budget import design
from experiments.sweep import engine as engines
from experiments.sweep import spec

STUDIES = {
    "cameras": study_cameras,
    "force": study_force,
    "joints": study_joints,
    "paper": study_paper,
    "phantom": study_phantom,
    "twin": study_twin,
    "weights": study_weights,
}
SWEPT = {"sweep": study_sweep, "population": study_population, "budget": study_budget}
"""Studies of many scans."""
MANY = 10_000
"""Scans that are asked about before they run."""
DASK = "dask://"
"""Before the scheduler in the option that names an engine."""


def study(
    name: tyro.conf.Positional[str],
    source: tyro.conf.Positional[Path | None] = None,
    /,
    out: Out | None = None,
    seed: Seed = 0,
    count: int | None = None,
    samples: int | None = None,
    workers: int | None = None,
    engine: str | None = None,
    yes: bool = False,
) -> None:
    """Answer one question about the twin, with figures and tables.

    Args:
        name: Which study. budget: what each source of error costs, three hours. cameras: what the
            simulated cameras' errors are and cost. force: how well each force law holds the probe,
            an hour. joints: what the six joints do along the loop, with fixed and with free roll.
            paper: every figure and table of the paper beside the twin's. phantom: how far its
            mechanics can be trusted, and what they cost. population: how many of many breasts are
            scanned well. report: the page of a sweep's data set. sweep: what scans do when their
            settings vary. twin: how the simulated arm and its wrist sensor behave. weights: what
            the weights of a NURBS curve do.
        source: Of a sweep its file, of a report the data set (docs/studies.md).
        out: Folder for the results, by default out/study_NAME; a sweep that was cut off goes on in
            its own.
        seed: Seed of everything random.
        count: Breasts of a population, 200 by default; of a budget the scans with each source alone
            and left out, 20 by default.
        samples: Groups of scans of a budget for indices of variance, 64 by default.
        workers: Processes that scan, by default one a core.
        engine: dask://HOST:PORT, a scheduler whose workers scan instead.
        yes: Whether ten thousand scans or more may run without a question.

    Raises:
        ConfigError: There is no such study, it has no use for an option, or a file or folder cannot
            be used.
    """
    require_seed(seed)
    require_known(name, (*STUDIES, *SWEPT, "report"), "study")
    swept, filed = name in SWEPT, name in ("sweep", "report")
    require_used(
        {
            f"study {name} takes a file: give it behind the name": filed and source is None,
            f"study {name} takes no file, got {source}": not filed and source is not None,
            "--count is a population's or a budget's": (
                count is not None and name not in ("population", "budget")
            ),
            "--samples are a budget's": samples is not None and name != "budget",
            f"--workers, --engine and --yes are for many scans: {', '.join(SWEPT)}": (
                not swept and (workers, engine, yes) != (None, None, False)
            ),
            "--workers are this machine's, and --engine brings its own": (
                workers is not None and engine is not None
            ),
            f"--workers must be 1 at least, got {workers}": workers is not None and workers < 1,
            "a report draws nothing at random: leave out --seed": name == "report" and seed != 0,
        }
    )
    folder = out or Path(f"out/study_{name}")
    if name == "report":
        assert source is not None, "required above"
        folder = out or source.parent
        study_sweep.write_page(source, folder)
    elif swept:
        if engine is None:
            chosen = engines.here(workers or os.cpu_count() or 1)
        else:
            chosen = engines.dask(_scheduler(engine), folder)
        if name == "budget":
            asked = design.load(count, samples, folder)
        else:
            asked = study_population.spec(count) if source is None else spec.load(source)
        _require_agreed(asked.size, yes)
        with _progress(len(asked.runs(seed))) as done:
            SWEPT[name].run(asked, folder, seed=seed, engine=chosen, told=done)
        console.print(f"Data set: {folder / f'{name}.parquet'}", soft_wrap=True)
    else:
        STUDIES[name].run(folder, seed=seed)
    console.print(f"Figures and tables in {folder}", soft_wrap=True)


def _scheduler(option: str) -> str:
    """HOST:PORT in `dask://HOST:PORT`.

    Raises:
        ConfigError: The option is of another form.
    """
    address = option.removeprefix(DASK)
    if address == option or not address.rpartition(":")[2].isdigit():
        raise ConfigError(f"there is no engine {option!r}: give {DASK}HOST:PORT", option)
    return address


def _require_agreed(scans: int, agreed: bool) -> None:
    """Ask before what takes days.

    Raises:
        ConfigError: Nobody agreed.
    """
    if scans < MANY or agreed:
        return
    answer = ""
    if sys.stdin.isatty():
        answer = console.input(f"These are {scans} scans. Type 'yes' to run them: ")
    if answer.strip() != "yes":
        raise ConfigError(
            f"{scans} scans were not begun: type yes when asked, or give --yes", scans
        )


@contextmanager
def _progress(scans: int) -> Iterator[Callable[[int], None]]:
    """One line for all scans: how many have ended, and how long the others will take."""
    with progress_bars() as listener:
        yield lambda done: listener(f"{scans} scans", done / scans)
