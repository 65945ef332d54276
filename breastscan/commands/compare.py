"""Two run folders side by side: a hardware run and its twin, or a scan before and after a
change.
"""

from pathlib import Path

import tyro
from rich.table import Table

from breastscan.commands.console import Out, console
from breastscan.report import difference_figures
from breastscan.report.catalogue import number
from breastscan.report.difference import Difference, difference, statistics
from breastscan.run import writing
from breastscan.run.columns import LOG_FILE, MM_PER_M, Trajectory
from breastscan.run.provenance import provenance


def compare(
    first: tyro.conf.Positional[Path],
    second: tyro.conf.Positional[Path],
    /,
    out: Out = Path("out/compare"),
) -> None:
    """Say what one scan did otherwise than another, at equal path length over the loop.

    Args:
        first: Folder of a scan.
        second: Folder of another scan of the same place; differences are this one minus the first.
        out: Folder for compare.json and the figures joints.png, tip.png and force.png.

    Raises:
        ConfigError: A folder is no run, the two do not overlap, or `out` cannot be written.
    """
    logs = [Trajectory.load(folder / LOG_FILE) for folder in (first, second)]
    found = difference(logs[0], logs[1], (str(first), str(second)))
    with writing.staged(out) as folder:
        writing.write_json(folder / "compare.json", _content(found, first, second))
        difference_figures.write(folder, found, _labels(first, second))
    console.print(_table(found))
    console.print(f"Figures and compare.json in {out}", soft_wrap=True)


def _table(found: Difference) -> Table:
    """The differences for the terminal."""
    shown = Table(
        title="Second minus first run, over the loop", title_justify="left", header_style="bold"
    )
    shown.add_column("Quantity")
    for heading in ("Mean", "RMS", "Largest", "at mm"):
        shown.add_column(heading, justify="right")
    for name, values in statistics(found).items():
        mean, rms, largest, place_mm = values.values()
        shown.add_row(name, number(mean), number(rms), number(largest), f"{place_mm:.1f}")
    return shown


def _content(found: Difference, first: Path, second: Path) -> dict[str, object]:
    return {
        "first": first,
        "second": second,
        "path_from_mm": float(found.first.s[0]) * MM_PER_M,
        "path_to_mm": float(found.first.s[-1]) * MM_PER_M,
        "differences": statistics(found),
        **provenance(),
    }


def _labels(first: Path, second: Path) -> tuple[str, str]:
    """Short names of the two folders that still tell them apart."""
    if first.name == second.name:
        return str(first), str(second)
    return first.name, second.name
