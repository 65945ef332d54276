"""The summary of a run for the terminal."""

from itertools import groupby
from typing import Any

from rich.table import Table
from rich.text import Text

from breastscan.report import catalogue


def summary(metrics: dict[str, Any]) -> Table:
    """What a run measured (the content of `metrics.json`), grouped, in plain names and units."""
    table = Table(title="Scan", title_justify="left", header_style="bold")
    table.add_column("")
    table.add_column("Quantity")
    table.add_column("Value", justify="right")
    table.add_column("Unit")
    for group, members in groupby(catalogue.rows(metrics), key=lambda row: row.group):
        for index, row in enumerate(members):
            heading = Text(group if index == 0 else "", style="bold")
            table.add_row(heading, Text(row.label), Text(row.value), Text(row.unit))
        table.add_section()
    return table
