"""Two run folders side by side: a hardware run and its twin, or a scan before and after a change."""

from pathlib import Path

from rich.table import Table

from breastscan.errors import ConfigError
from breastscan.report import difference_figures
from breastscan.report.catalogue import number
from breastscan.report.difference import Difference, difference, statistics
from breastscan.run import writing
from breastscan.run.columns import MM_PER_M, Trajectory

LOG_FILE = "trajectory.parquet"


def compare(first: Path, second: Path, out: Path) -> Difference:
    """Write what the second run did otherwise than the first into `out`: compare.json and three figures.

    Args:
        first: A run folder.
        second: Another.
        out: Folder for compare.json, joints.png, tip.png and force.png.

    Raises:
        ConfigError: A folder is no run, the two do not overlap, or `out` cannot be written.
    """
    found = difference(_load(first), _load(second), (str(first), str(second)))
    with writing.staged(out) as folder:
        writing.write_json(folder / "compare.json", _content(found, first, second))
        difference_figures.write(folder, found, _labels(first, second))
    return found


def table(found: Difference) -> Table:
    """The differences for the terminal."""
    shown = Table(title="Second minus first run, over the loop", title_justify="left", header_style="bold")
    shown.add_column("Quantity")
    for heading in ("Mean", "RMS", "Largest", "at mm"):
        shown.add_column(heading, justify="right")
    for name, values in statistics(found).items():
        mean, rms, largest, place_mm = values.values()
        shown.add_row(name, number(mean), number(rms), number(largest), f"{place_mm:.1f}")
    return shown


def _load(folder: Path) -> Trajectory:
    path = folder / LOG_FILE
    if not path.is_file():
        raise ConfigError(
            f"{folder} is not a run: expected a folder with {LOG_FILE}, as `breastscan scan --out {folder}` writes it",
            folder,
        )
    return Trajectory.load(path)


def _content(found: Difference, first: Path, second: Path) -> dict[str, object]:
    return {
        "first": first,
        "second": second,
        "path_from_mm": float(found.first.s[0]) * MM_PER_M,
        "path_to_mm": float(found.first.s[-1]) * MM_PER_M,
        "differences": statistics(found),
        "versions": writing.versions(),
    }


def _labels(first: Path, second: Path) -> tuple[str, str]:
    """Short names of the two folders that still tell them apart."""
    if first.name == second.name:
        return str(first), str(second)
    return first.name, second.name
