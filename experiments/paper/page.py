"""All items on one page, as Markdown, and as files: figures as PNG and SVG, data as CSV and
Parquet.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from breastscan.report import catalogue, html, origin, theme
from breastscan.run import parquet, writing
from breastscan.run.provenance import provenance
from experiments.paper.item import HEADINGS, ILLUSTRATIONS, Item

TITLE = "The paper, figure by figure"
INTRODUCTION = (
    "Every figure and table of the paper that a simulation can answer: the paper's own statement, "
    "what the twin gives, and a verdict. Where the paper gives no number there is none to reach; "
    "then the verdict is about its words. The twin's cameras are the paper's own (Tables 1 and 2), "
    "its breast is another one."
)


def write(folder: Path, items: Sequence[Item], *, seed: int) -> None:
    """Write the page, `study.md`, `study.json` and the files of every item into `folder`."""
    ordered = sorted(items, key=lambda item: HEADINGS.index(item.heading))
    for item in ordered:
        _write_files(folder, item, seed)
    settings = {"seed": seed, **provenance()}
    (folder / "study.html").write_text(page(ordered, settings), encoding="utf-8")
    (folder / "study.md").write_text("\n".join(_markdown(ordered)) + "\n", encoding="utf-8")
    verdicts = [
        {"item": i.heading, "verdict": i.verdict, "ours": i.ours, "why": i.why} for i in ordered
    ]
    writing.write_json(folder / "study.json", {"items": verdicts, **settings})


def page(items: Sequence[Item], settings: dict) -> str:
    """The whole page as one text."""
    header = (
        f"<header>\n<h1>{TITLE}</h1>\n{html.paragraph(INTRODUCTION)}\n"
        f"{html.pairs(origin.of(settings))}\n</header>"
    )
    rows = [(item.heading, item.ours, item.verdict) for item in items]
    overview = html.section("Overview", html.table(("item", "here", "verdict"), rows, [2]))
    return html.document(TITLE, [header, overview, *(_section(item) for item in items)])


def headline(items: Sequence[Item]) -> Iterator[str]:
    """A Markdown table, a row an item that claims something."""
    yield "| item | here | verdict |"
    yield "|---|---|---|"
    for item in items:
        if item.heading not in ILLUSTRATIONS:
            yield f"| {item.heading} | {item.ours} | {item.verdict} |"


def _section(item: Item) -> str:
    drawn = "" if item.figure is None else html.drawing(item.figure, item.shows, item.shows)
    return html.section(
        item.heading, html.pairs(_lines(item)), drawn, _table(item), html.paragraph(_where(item))
    )


def _lines(item: Item) -> list[tuple[str, str]]:
    lines = [
        ("the paper", item.statement),
        ("corrected", item.correction),
        ("here", item.ours),
        ("verdict", f"{item.verdict}: {item.why}"),
    ]
    return [(name, text) for name, text in lines if text]


def _where(item: Item) -> str:
    kinds = "csv, .parquet" if item.figure is None else "csv, .parquet, .png, .svg"
    return f"Files: {item.stem}.{kinds}"


def _table(item: Item) -> str:
    """The data of an item that has no figure."""
    if item.figure is not None:
        return ""
    frame = _frame(item)
    rows = [[_cell(value) for value in row] for row in frame.iter_rows()]
    numeric = [i for i, kind in enumerate(frame.dtypes) if kind.is_numeric()]
    return html.table(frame.columns, rows, numeric=numeric)


def _cell(value: object) -> str:
    """With as many digits as tell a calibrated length from the paper's."""
    if not isinstance(value, int | float):
        return str(value)
    return f"{value:.6g}" if abs(value) >= 1 else catalogue.number(float(value))


def _frame(item: Item) -> pl.DataFrame:
    return pl.DataFrame({column.name: values for column, values in item.data.items()})


def _write_files(folder: Path, item: Item, seed: int) -> None:
    columns = {column.name: (column,) for column in item.data}
    values = {c.name: _plain(v) for c, v in item.data.items()}
    parquet.write(folder / f"{item.stem}.parquet", columns, values, seed)
    writing.write_csv(folder / f"{item.stem}.csv", _frame(item))
    if item.figure is not None:
        theme.write_png(item.figure, folder / f"{item.stem}.png")
        theme.write_svg(item.figure, folder / f"{item.stem}.svg", item.shows)


def _plain(values: np.ndarray) -> np.ndarray:
    """Numbers as the file's format has them."""
    return values.astype(float) if values.dtype.kind in "iu" else values


def _markdown(items: Sequence[Item]) -> Iterator[str]:
    yield f"# {TITLE}\n\n{INTRODUCTION}\n"
    yield from headline(items)
    for item in items:
        yield f"\n## {item.heading}\n"
        yield from (f"- {name}: {text}" for name, text in _lines(item))
        yield f"- {_where(item)}"
        if item.figure is not None:
            yield f"\n![{item.shows}]({item.stem}.png)"
