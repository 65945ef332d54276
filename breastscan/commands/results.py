"""What the commands that scan leave behind and say at the end."""

import json
from pathlib import Path
from typing import Any

from breastscan import report
from breastscan.commands.console import console
from breastscan.run.columns import Trajectory
from breastscan.run.writing import write_aborted, write_json
from breastscan.scan import Keep, Stages


def keep_aborted(out: Path) -> Keep:
    """What saves the trajectory of a scan that is cut off, beside earlier results, and says
    where.
    """

    def keep(trajectory: Trajectory, error: BaseException) -> None:
        folder = write_aborted(out, trajectory, error)
        console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)

    return keep


def write_report(folder: Path, metrics: dict[str, Any], stages: Stages) -> None:
    """Metrics, with the wall time of each stage, and the page."""
    with stages.stage("report"):
        metrics["wall_s"] = {name: round(seconds, 3) for name, seconds in stages.wall_s.items()}
        write_json(folder / "metrics.json", metrics)
        report.write(folder)


def summarise(out: Path, metrics: dict[str, Any]) -> None:
    """The metrics in short, each beside its bar, what the run was made with, and where the page
    lies.
    """
    settings = json.loads((out / "config.json").read_text(encoding="utf-8"))
    console.print(report.summary(metrics, settings))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)
