"""docs/data.md says what a run's files hold, and the code agrees."""

import re
from pathlib import Path

import pytest

from breastscan.report.catalogue import CATALOGUE
from breastscan.run.columns import FRAMES, LOG, PATH, TRUTH, markdown, names
from breastscan.run.reading import REQUIRED_FILES
from breastscan.run.trajectory import Trajectory

PAGE = (Path(__file__).parents[2] / "docs" / "data.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("columns", [LOG, PATH, TRUTH], ids=["log", "path", "truth"])
def test_the_page_holds_the_table_of_columns(columns):
    assert markdown(columns) in PAGE, "renew docs/data.md by `python -m breastscan.run.columns`"


def test_every_field_of_the_log_has_its_columns():
    assert tuple(LOG) == tuple(Trajectory.__dataclass_fields__)
    assert len(set(names(LOG))) == len(names(LOG))


@pytest.mark.parametrize(
    "column", [c for table in (LOG, PATH, TRUTH) for g in table.values() for c in g]
)
def test_a_columns_unit_stands_in_its_name_and_its_frame_in_the_list(column):
    suffix = {
        "": "",
        "m": "_m",
        "s": "_s",
        "rad": "_rad",
        "rad/s": "_rad_s",
        "N": "_n",
        "N m": "_nm",
    }
    assert column.name.endswith(suffix[column.unit])
    assert column.frame in ("", *FRAMES)


def test_the_page_lists_every_metric_and_no_other():
    section = PAGE.split("## metrics.json")[1].split("\n## ")[0]
    keys = [
        key
        for line in section.splitlines()
        if line.startswith("| `")
        for key in re.findall(r"`(\w+)`", line.split("|")[1])
    ]
    assert sorted(keys) == sorted(metric.key for metric in CATALOGUE)


@pytest.mark.parametrize("file", [*REQUIRED_FILES, "cell.json", "report.html", "scan.mp4"])
def test_the_page_lists_every_file(file):
    assert f"`{file}`" in PAGE
