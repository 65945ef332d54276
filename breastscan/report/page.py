"""The report of a run: one HTML file that opens without a network."""

from importlib.resources import files
from pathlib import Path

from breastscan.report import cloud_view, sections
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
    """The whole page as one text; the 3D view's scripts come last, so that everything else is
    shown at once.
    """
    style = files("breastscan.report").joinpath("page.css").read_text(encoding="utf-8")
    view = cloud_view.figure(run.cloud_B, run.path_B, run.normals_B, run.trajectory)
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            "<title>Breast scan: "
            f"report</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>",
            sections.headline(run),
            sections.summary(run),
            sections.perception(run),
            sections.path(run),
            sections.joints(run),
            sections.contact(run),
            sections.time(run),
            sections.settings(run),
            f"</main>\n{cloud_view.script(view)}\n</body>\n</html>\n",
        ]
    )
