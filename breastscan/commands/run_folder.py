"""What every scan leaves behind, whichever robot ran it, and what it says while it runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from breastscan import report
from breastscan.run import writing
from breastscan.scan import ScanResult, Stages


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a scan did, and how well as far as is known."""

    result: ScanResult
    trajectory: pl.DataFrame
    metrics: dict[str, Any]


def write(folder: Path, measured: Measured, settings: dict[str, object]) -> None:
    """Everything but metrics, video and page."""
    result = measured.result
    writing.write_json(folder / "config.json", {**settings, "versions": writing.versions()})
    writing.write_image(folder / "left.png", result.images.left)
    writing.write_image(folder / "right.png", result.images.right)
    writing.write_image(folder / "disparity.png", writing.disparity_picture(result.reconstruction.disparity))
    writing.write_cloud(folder / "cloud.ply", result.plan.points_B, result.plan.normals_B)
    writing.write_path(folder / "path.csv", result.plan.path.points_B, result.plan.path.normals_B)
    measured.trajectory.write_parquet(folder / "trajectory.parquet")


def keep_aborted(out: Path, table: pl.DataFrame, error: BaseException, console: Console) -> None:
    """Save what was measured before a scan was cut off, and say where."""
    folder = writing.write_aborted(out, table, error)
    console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)


def write_report(folder: Path, measured: Measured, stages: Stages) -> None:
    """Metrics, with the wall time of each stage, and the page."""
    with stages.stage("report"):
        measured.metrics["wall_s"] = {name: round(seconds, 3) for name, seconds in stages.wall_s.items()}
        writing.write_json(folder / "metrics.json", measured.metrics)
        report.write(folder)


def summarise(out: Path, measured: Measured, console: Console) -> None:
    """The metrics in short, and where the page lies."""
    console.print(report.summary(measured.metrics))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)


@contextmanager
def progress_bars(console: Console) -> Iterator[Callable[[str, float], None]]:
    """A listener for `Stages` that shows one line of progress for each stage."""
    progress = Progress(
        TextColumn("{task.description:<14}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), console=console,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def listen(stage: str, share: float) -> None:
        if stage not in tasks:
            tasks[stage] = progress.add_task(stage, total=1.0)
        progress.update(tasks[stage], completed=share)

    with progress:
        yield listen
