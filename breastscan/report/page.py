"""The report of a run: one HTML file that opens without a network."""

from pathlib import Path

from breastscan.report import cloud_view, html, sections
from breastscan.run.reading import Run

REPORT_FILE = "report.html"


def write(folder: Path) -> Path:
    """Write `report.html` into a run folder.

    Args:
        folder: What a finished scan left behind.

    Returns:
        The page.

    Raises:
        ConfigError: The folder lacks a file, or holds one that cannot be read.
    """
    path = folder / REPORT_FILE
    path.write_text(page(Run.load(folder)), encoding="utf-8")
    return path


def page(run: Run) -> str:
    """The whole page as one text."""
    view = cloud_view.figure(run.cloud_B, run.path_B, run.normals_B, run.trajectory)
    blocks = [
        sections.headline(run),
        sections.summary(run),
        sections.perception(run),
        sections.path(run),
        sections.coverage(run),
        sections.joints(run),
        sections.contact(run),
        sections.time(run),
        sections.settings(run),
    ]
    return html.document("Breast scan: report", blocks, cloud_view.script(view))
