"""The report of a sweep: one HTML file that opens without a network."""

from pathlib import Path

import polars as pl

from breastscan.report import html, interactive
from breastscan.report.page import REPORT_FILE
from experiments.sweep import failures, figures, sections
from experiments.sweep.study import Meta as Meta
from experiments.sweep.study import study


def write(frame: pl.DataFrame, meta: Meta, folder: Path) -> None:
    """Write `report.html` into a folder.

    Args:
        frame: A row a run: `run`, `design`, `error`, `refused`, what was varied, what was measured.
        meta: Where it comes from.
        folder: Where to.

    Raises:
        ConfigError: The data set holds no run, or lacks a column.
    """
    found = study(frame, meta)
    several = len(found.frame) > 1 and bool(found.settings or found.main)
    blocks = [
        sections.headline(found),
        sections.metrics(found),
        sections.main_effects(found),
        sections.scatter(found),
        sections.parallel(found) if several else "",
        failures.section(found),
        sections.specification(found),
    ]
    scripts = ""
    if several:
        view = figures.parallel(found.frame, *sections.parallel_axes(found))
        scripts = interactive.script(view, sections.ELEMENT_ID)
    page = html.document(meta.title, blocks, scripts)
    (folder / REPORT_FILE).write_text(page, encoding="utf-8")
