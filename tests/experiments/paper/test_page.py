"""The page has a part for every item, and every figure and table lies beside it as files."""

import json
import re
from pathlib import Path
from typing import get_args

import numpy as np
import polars as pl
import pytest

from breastscan.report import theme
from experiments.paper import page
from experiments.paper.item import HEADINGS, ILLUSTRATIONS, Item, Verdict, column


def item(heading, **other):
    return Item(
        heading=heading,
        ours="1.5 < 2 mm",
        verdict="better",
        why="it is less.",
        data={
            column("point", "number of the point"): np.arange(3),
            column("error_mm", "executed minus planned", "mm", "B"): np.array([0.1, 0.2, 0.3]),
            column("name", "of the point", kind="text"): np.array(["a", "b", "c"]),
        },
        **other,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    figure, ((axis,),) = theme.panels(1, 1, height_in=2.0)
    axis.plot([0, 1], **theme.MEASURED_LINE)
    place = tmp_path_factory.mktemp("paper")
    page.write(place, [item("Table 4"), item("Fig. 3", figure=figure, shows="A line.")], seed=3)
    return place


def test_headings_are_the_papers_and_in_its_order(folder):
    text = (folder / "study.html").read_text(encoding="utf-8")
    assert re.findall("<h2>(.*?)</h2>", text) == ["Overview", "Fig. 3", "Table 4"]
    assert "1.5 &lt; 2 mm" in text
    assert "<svg" in text
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)


def test_the_markdown_says_the_same(folder):
    text = (folder / "study.md").read_text(encoding="utf-8")
    assert re.findall("^## (.*)$", text, flags=re.MULTILINE) == ["Fig. 3", "Table 4"]
    assert "| Table 4 | 1.5 < 2 mm | better |" in text
    assert "![A line.](fig_3.png)" in text


def test_the_data_lies_beside_as_csv_and_parquet_that_explains_itself(folder):
    for stem in ("fig_3", "table_4"):
        table = pl.read_parquet(folder / f"{stem}.parquet")
        assert table.equals(pl.read_csv(folder / f"{stem}.csv").cast({"point": pl.Float64}))
    told = json.loads(pl.read_parquet_metadata(folder / "table_4.parquet")["columns"])
    assert told["error_mm"] == {"unit": "mm", "frame": "B", "meaning": "executed minus planned"}


def test_a_figures_svg_stands_without_the_page(folder):
    assert (folder / "fig_3.png").stat().st_size > 1000
    svg = (folder / "fig_3.svg").read_text(encoding="utf-8")
    assert svg.startswith("<svg")
    assert theme.MEASURED in svg
    assert "var(" not in svg
    assert not (folder / "table_4.svg").exists()


def test_the_verdicts_can_be_read_by_programs(folder):
    found = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    assert found["seed"] == 3
    assert [(i["item"], i["verdict"]) for i in found["items"]] == [
        ("Fig. 3", "better"),
        ("Table 4", "better"),
    ]


def test_the_guide_has_the_commands_row_of_every_item():
    guide = (Path(__file__).parents[3] / "docs/paper.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+?) \| .* \| (.+?) \|$", guide, flags=re.MULTILINE)
    assert [name for name, _ in rows[1:]] == [h for h in HEADINGS if h not in ILLUSTRATIONS]
    assert {verdict for _, verdict in rows[1:]} <= set(get_args(Verdict))
    assert "breastscan study paper" in guide
