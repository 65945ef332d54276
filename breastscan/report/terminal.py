"""The summary of a run for the terminal."""

from itertools import groupby
from typing import Any

from rich.table import Table
from rich.text import Text

from breastscan.report import catalogue, origin
from breastscan.run.bars import scan_bars

STYLES = {catalogue.HOLDS: "green", catalogue.MISSED: "bold red"}


def summary(metrics: dict[str, Any], settings: dict[str, Any]) -> Table:
    """What a run measured (the content of `metrics.json`), grouped, in plain names and units, each
    beside its bar; and what it was made with (of `config.json`). The stages' times are left to the
    progress bars.
    """
    table = Table(
        title="Scan",
        title_justify="left",
        header_style="bold",
        caption=Text("\n".join(f"{name}: {value}" for name, value in origin.of(settings))),
        caption_justify="left",
    )
    table.add_column("Quantity")
    table.add_column("Value", justify="right")
    table.add_column("Unit")
    table.add_column("Bar", no_wrap=True)
    table.add_column("", no_wrap=True)
    rows = catalogue.rows(metrics, scan_bars(settings))
    shown = (row for row in rows if row.key != "wall_s")
    for group, members in groupby(shown, key=lambda row: row.group):
        table.add_row(Text(group, style="bold"))
        for row in members:
            cells = (Text(cell) for cell in (row.label, row.value, row.unit, row.bar))
            table.add_row(*cells, Text(row.verdict, style=STYLES.get(row.verdict, "")))
        table.add_section()
    return table
