"""What the commands that scan leave behind and say at the end."""

import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from breastscan import report
from breastscan.commands.console import console
from breastscan.errors import ConfigError
from breastscan.scan import ScanPlan, ScanResult, Stages


def leave(
    out: Path,
    folder: Path,
    result: ScanResult,
    stages: Stages,
    settings: dict[str, Any],
    film: Callable[[], None] = lambda: None,
) -> None:
    """Leave the complete run folder of a scan.

    Args:
        out: Where the user will find it.
        folder: Where its files are staged.
        result: The scan.
        stages: Takes the wall time.
        settings: What it was made with beside its config, for `config.json`.
        film: Makes the video, if there is to be one.

    Raises:
        ConfigError: Something could not be written; says why, and where the results are.
    """

    def save(place: Path) -> None:
        result.save(place, **settings)

    with kept_elsewhere(out, save):
        film()
        save(folder)
        with stages.stage("report"):
            report.write(folder)


@contextmanager
def kept_elsewhere(out: Path, save: Callable[[Path], None]) -> Iterator[None]:
    """Where the block cannot write, save what a scan measured into a folder for temporary files.

    Args:
        out: Where the block writes.
        save: Writes what was measured into a folder.

    Raises:
        ConfigError: Something could not be written; says why, and where the results are.
    """
    try:
        yield
    except OSError as error:
        folder = elsewhere()
        save(folder)
        raise ConfigError(
            f"cannot write to {out} ({error.strerror or error}): what was measured is in {folder}",
            out,
        ) from error


def elsewhere() -> Path:
    """A new folder for temporary files."""
    return Path(tempfile.mkdtemp(prefix="breastscan-"))


def tell_plan(plan: ScanPlan) -> None:
    """What a user has to know of the plan: where it is not what was asked for."""
    for told in (plan.gave_way, plan.hidden_speed):
        if told:
            console.print(f"[yellow]{told}[/]", soft_wrap=True)


def summarise(out: Path, result: ScanResult) -> None:
    """The metrics in short, each beside its bar, what the run was made with, and where the page
    lies.
    """
    settings = json.loads((out / "config.json").read_text(encoding="utf-8"))
    console.print(report.summary(result.summary(), settings))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)
