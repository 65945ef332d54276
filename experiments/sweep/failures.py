"""The runs that did not succeed, by cause."""

from collections import Counter
from html import escape
from pathlib import Path

import cv2
import polars as pl

from breastscan.report import html
from breastscan.report.catalogue import number
from experiments.sweep.statistics import percent
from experiments.sweep.study import Study

SHOWN_CAUSES = 12
"""Causes of failure with a run of each."""
LISTED_RUNS = 20
"""Numbers of runs that are told for a cause."""
UNNAMED = "no cause given"


def section(study: Study) -> str:
    """Runs that did not succeed, by cause, the most frequent first."""
    failed = _with_cause(study.frame.filter(pl.col("success") == 0))
    if failed.is_empty():
        return html.section("Failures", html.paragraph("Every run succeeded."))
    causes = [cause for cause, _ in Counter(failed["cause"]).most_common()]
    rows = [_cause_row(study, failed, cause) for cause in causes]
    header = (
        "cause",
        "runs",
        "of all",
        "95 % interval",
        "refused before contact",
        "touched",
        "which",
    )
    blocks = [_cause(study, failed, cause) for cause in causes[:SHOWN_CAUSES]]
    left_out = len(causes) - len(blocks)
    return html.section(
        "Failures",
        html.table(header, rows, numeric=range(1, 6)),
        *blocks,
        html.paragraph(f"The other {left_out} causes have no run shown.") if left_out else "",
    )


def _with_cause(failed: pl.DataFrame) -> pl.DataFrame:
    """Each with a cause: the class of its error where none was given."""
    kind = pl.col("error").str.split(":").list.first()
    given = pl.col("cause") if "cause" in failed.columns else pl.lit(None, pl.String)
    return failed.with_columns(pl.coalesce(given, kind, pl.lit(UNNAMED)).alias("cause"))


def _cause_row(study: Study, failed: pl.DataFrame, cause: str) -> list[str]:
    own, n = failed.filter(pl.col("cause") == cause), len(study.frame)
    runs = own["run"].to_list()
    more = f" and {len(runs) - LISTED_RUNS} more" if len(runs) > LISTED_RUNS else ""
    touched = str(own["touched"].sum()) if "touched" in own.columns else "–"
    return [
        cause,
        str(len(own)),
        f"{100 * len(own) / n:.1f} %",
        percent(len(own), n),
        str(own["refused"].sum()),
        touched,
        ", ".join(map(str, runs[:LISTED_RUNS])) + more,
    ]


def _cause(study: Study, failed: pl.DataFrame, cause: str) -> str:
    """Where a cause is met, and one run of it."""
    own = failed.filter(pl.col("cause") == cause)
    run = _shown_run(own)
    image = _image(study.meta.pictures, run.get("picture"))
    told = [("run", str(run["run"])), ("error", run["error"]), ("command", run.get("command"))]
    rows = [(name, _range(own[name]), _range(study.frame[name])) for name in study.settings]
    return "\n".join(
        [
            f"<h3>{escape(cause)}</h3>",
            f'<div class="pictures">{image}</div>' if image else "",
            html.pairs([(name, str(text)) for name, text in told if text is not None]),
            html.table(("setting", "in these runs", "in all"), rows) if rows else "",
        ]
    )


def _shown_run(own: pl.DataFrame) -> dict:
    """The first run of which there is a picture, else the first."""
    if "picture" in own.columns:
        own = own.sort(pl.col("picture").is_null(), maintain_order=True)
    return own.row(0, named=True)


def _image(folder: Path, name: str | None) -> str:
    """A picture; nothing where there is none, or it cannot be read."""
    if name is None or not (folder / name).is_file():
        return ""
    image = cv2.imread(str(folder / name), cv2.IMREAD_COLOR)
    return "" if image is None else html.captioned(html.picture(image, name), name)


def _range(values: pl.Series) -> str:
    """From where to where numbers go, or the words with how often each is there."""
    known = values.drop_nulls()
    if known.is_empty():
        return "–"
    if known.dtype.is_numeric():
        numbers = known.to_numpy()
        low, high = float(numbers.min()), float(numbers.max())
        return number(low) if low == high else f"{number(low)} … {number(high)}"
    return ", ".join(f"{word} ({count})" for word, count in Counter(known).most_common())
