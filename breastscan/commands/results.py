"""What the commands that scan leave behind and say at the end."""

from pathlib import Path

from breastscan import report
from breastscan.commands.console import console
from breastscan.run.trajectory import Trajectory
from breastscan.run.writing import write_aborted
from breastscan.scan import Keep, ScanResult


def keep_aborted(out: Path) -> Keep:
    """What saves the trajectory of a scan that is cut off, beside earlier results, and says
    where.
    """

    def keep(trajectory: Trajectory, error: BaseException) -> None:
        folder = write_aborted(out, trajectory, error)
        console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)

    return keep


def summarise(out: Path, result: ScanResult) -> None:
    """The metrics in short, and where the page lies."""
    console.print(report.summary(result.summary()))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)
