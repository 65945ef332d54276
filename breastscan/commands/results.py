"""What the commands that scan leave behind and say at the end."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from polars.exceptions import PolarsError

from breastscan import report
from breastscan.commands.console import console
from breastscan.errors import ConfigError
from breastscan.run.columns import Trajectory
from breastscan.run.writing import write_aborted, write_json, write_settings
from breastscan.scan import Keep, ScanPlan, ScanResult, Stages


def keep_aborted(out: Path) -> Keep:
    """What saves the trajectory of a scan that is cut off, beside earlier results, and says
    where.
    """

    def keep(trajectory: Trajectory, error: BaseException) -> None:
        try:
            folder = write_aborted(out, trajectory, error)
        except (OSError, PolarsError):
            folder = write_aborted(_elsewhere(), trajectory, error)
        console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)

    return keep


@contextmanager
def kept_elsewhere(
    out: Path, result: ScanResult, settings: dict[str, Any], metrics: dict[str, Any]
) -> Iterator[None]:
    """Where the block cannot write, put what a scan measured into a folder for temporary files.

    Raises:
        ConfigError: Something could not be written; says why, and where the results are.
    """
    try:
        yield
    except (OSError, PolarsError) as error:
        folder = _elsewhere()
        result.save(folder)
        write_settings(folder, settings)
        write_json(folder / "metrics.json", metrics)
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"cannot write to {out} ({reason}): what was measured is in {folder}", out
        ) from error


def _elsewhere() -> Path:
    return Path(tempfile.mkdtemp(prefix="breastscan-"))


def tell_plan(plan: ScanPlan) -> None:
    """What a user who set a speed has to know of the plan."""
    if plan.hidden_speed:
        console.print(f"[yellow]{plan.hidden_speed}[/]", soft_wrap=True)


def write_report(folder: Path, metrics: dict[str, Any], stages: Stages) -> None:
    """Metrics, with the wall time of each stage, and the page."""
    with stages.stage("report"):
        metrics["wall_s"] = {name: round(seconds, 3) for name, seconds in stages.wall_s.items()}
        write_json(folder / "metrics.json", metrics)
        report.write(folder)


def summarise(out: Path, metrics: dict[str, Any]) -> None:
    """The metrics in short, and where the page lies."""
    console.print(report.summary(metrics))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)
