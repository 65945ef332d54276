"""The terminal's summary names what was measured and takes no text for markup."""

import io

from rich.console import Console

from breastscan.report import summary
from tests.run.synthetic_run import METRICS


def printed(metrics):
    console = Console(file=io.StringIO(), width=120)
    console.print(summary(metrics))
    return console.file.getvalue()


def test_the_summary_shows_group_quantity_value_and_unit():
    line = next(line for line in printed(METRICS).splitlines() if "Surface error, RMS" in line)
    assert [cell.strip() for cell in line.strip("│").split("│")] == [
        "Perception",
        "Surface error, RMS",
        "0.0812",
        "mm",
    ]


def test_each_group_is_named_once():
    assert printed(METRICS).count("Execution") == 1


def test_names_in_brackets_are_shown_as_they_are():
    assert "gain[bold]x" in printed({"gain[bold]x": 1.0})
