"""The budget as a person reads it: one figure, two tables, and what failed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from breastscan.report import html, origin, theme
from breastscan.report.catalogue import number
from breastscan.run import writing
from breastscan.run.provenance import provenance
from experiments.budget.design import ALL, FIRST, NONE, SECOND, Scans, exchanged
from experiments.budget.estimates import Budget, Contribution, Estimate

TITLE = "Where the error comes from"
INTRODUCTION = (
    "Every source of error of a scan in the twin: by itself, left out of all, and as a share of "
    "the variance. Errors of independent causes add in the mean square, so a source's part is its "
    "share of the mean square error with all sources realistic. Brackets after a share hold its "
    "95 % interval, by bootstrap over the rows of draws; after an error, how many scans it is of."
)
SHOWN = (
    "Bars: mean square that a source adds by itself. Dots: that is saved where it alone is made "
    "ideal. Both over the mean square with all sources. Diamonds: its total index, the share of "
    "the variance between scans that goes with it. Below the line: what the method leaves with "
    "all sources ideal, and what the sources add only together, or less together (negative)."
)
WHY_NOT = (
    "Where they differ: a source that errs by the same amount in every scan adds to the error and "
    "has no variance; one that makes up for another adds more alone than is saved without it."
)
LARGEST = 5
"""Sources whose order is told."""
VIEWS = {"added": "by itself", "saved": "all but it", "total": "total index"}
"""The three ways to see a source."""
REMAINDERS = {"floor": "all ideal", "unattributed": "only together"}
SHARES = ("added", "saved", "first", "total")
"""All that is estimated of a source."""
HEADER = (
    "source", "by itself", "adds %", "all but it", "saves %", "first order %", "total order %",
)  # fmt: skip
ENDS = ("set", "scans", "ended well", "refused before contact", "failed")
CAUSES = ("why not", "scans", "of them refused")
OF_INDICES = "groups for the indices"
ROW_IN = 0.3
"""Height of a source in the figure."""
MEASURES = {
    "executed_truth_rms_mm": ("Error of the loop, RMS", "mm"),
    "force_rmse_n": ("Error of the force, RMS", "N"),
}
"""What is explained, by the metric's name, with its unit."""


@dataclass(frozen=True)
class Part:
    """A table under a heading, and what is said before it."""

    heading: str
    sentences: list[str]
    header: tuple[str, ...]
    rows: list[list[str]]


def write(
    folder: Path, budgets: Mapping[str, Budget], frame: pl.DataFrame, scans: Scans, seed: int
) -> None:
    """Write `budget.html`, `budget.png`, `budget.svg`, `study.md` and `estimates.csv`.

    Args:
        folder: Where to.
        budgets: By the metric's name.
        frame: The data set.
        scans: Which of its rows are of which set.
        seed: Of the draws.
    """
    drawn, settings = figure(budgets), {"seed": seed, **provenance()}
    parts = [Part(_heading(m), _sentences(m, b), HEADER, _rows(b)) for m, b in budgets.items()]
    parts += [
        Part("How the scans ended", [_groups(budgets, scans)], ENDS, _outcomes(frame, scans)),
        Part("Why others did not end well", [], CAUSES, _causes(frame)),
    ]
    theme.write_png(drawn, folder / "budget.png")
    theme.write_svg(drawn, folder / "budget.svg", SHOWN)
    (folder / "budget.html").write_text(_page(parts, drawn, settings), encoding="utf-8")
    (folder / "study.md").write_text("\n".join(_markdown(parts)), encoding="utf-8")
    writing.write_csv(folder / "estimates.csv", _estimates(budgets))


def figure(budgets: Mapping[str, Budget]) -> Figure:
    """Each source's parts in each error, the largest first."""
    order = _ordered(next(iter(budgets.values())))
    height = 1.6 + ROW_IN * (len(order) + len(REMAINDERS))
    drawn, (axes,) = theme.panels(1, len(budgets), height_in=height, sharey=True)
    marks: list[Any] = []
    for axis, (metric, budget) in zip(axes, budgets.items(), strict=True):
        by_source = {c.source: c for c in budget.contributions}
        marks = _draw(axis, [by_source[source] for source in order], budget)
        axis.set(xlabel="share [%]")
        theme.title(axis, f"{MEASURES[metric][0]}: {_levels(metric, budget)}")
    axes[0].set_yticks(range(len(order) + len(REMAINDERS)), [*order, *REMAINDERS.values()])
    axes[0].invert_yaxis()
    theme.legend_below(drawn, marks, len(marks))
    return drawn


def _draw(axis: Axes, sources: Sequence[Contribution], budget: Budget) -> list[Any]:
    """One error's panel; returns what its legend tells."""
    places, n = np.arange(len(sources)), len(sources)
    rest = [getattr(budget, name).value for name in REMAINDERS]
    added = _percent([c.added.value for c in sources])
    bars = axis.barh(places, added, 0.7, color=theme.FAMILY[5].color, label="adds by itself")
    axis.barh(n + np.arange(len(rest)), _percent(rest), 0.7, color=theme.GRID)
    saved = _marks(axis, places - 0.15, [c.saved for c in sources], theme.TRUTH, "o")
    total = _marks(axis, places + 0.15, [c.total for c in sources], theme.INK, "D")
    saved.set_label("saved without it")
    total.set_label("share of the variance")
    axis.axhline(n - 0.5, color=theme.MUTED, linewidth=0.8)
    axis.axvline(0.0, color=theme.MUTED, linewidth=0.8)
    return [bars, saved, total]


def _marks(
    axis: Axes, places: np.ndarray, found: Sequence[Estimate], color: str, marker: str
) -> Any:
    """Estimates with their intervals."""
    values = np.array([e.value for e in found])
    ends = np.array([(e.interval.low, e.interval.high) for e in found])
    reach = np.abs(np.nan_to_num(ends - values[:, None])).T
    look = {"fmt": marker, "color": color, "markersize": 4.0, "elinewidth": 0.9}
    return axis.errorbar(_percent(values), places, xerr=_percent(reach), **look)


def _percent(shares: ArrayLike) -> np.ndarray:
    return 100.0 * np.nan_to_num(np.asarray(shares, float))


def _ordered(budget: Budget) -> list[str]:
    """The sources, the one first that would save most."""

    def saved(one: Contribution) -> float:
        return float(np.nan_to_num(one.saved.value, nan=-np.inf))

    return [c.source for c in sorted(budget.contributions, key=saved, reverse=True)]


def _heading(metric: str) -> str:
    return f"{MEASURES[metric][0]} [{MEASURES[metric][1]}]"


def _levels(metric: str, budget: Budget) -> str:
    """How large the error is with all sources, and with none."""
    unit = MEASURES[metric][1]
    everything, nothing = (number(budget.levels[name].value) for name in (ALL, NONE))
    return f"{everything} {unit} with all, {nothing} with none"


def _sentences(metric: str, budget: Budget) -> list[str]:
    """What the numbers say in words."""
    unit = MEASURES[metric][1]
    levels = "; ".join(f"{name} {found.text}" for name, found in budget.levels.items())
    remainders = ", ".join(
        f"{name} {getattr(budget, key).text} %" for key, name in REMAINDERS.items()
    )
    orders = {told: budget.largest(view, LARGEST) for view, told in VIEWS.items()}
    agree = len({tuple(order) for order in orders.values()}) == 1
    verdict = "agree" if agree else "do not agree"
    return [
        f"Root mean square [{unit}] of a set's scans, and how many ended well: {levels}.",
        f"Of the mean square: {remainders}. Of the variance, what no source causes by itself: "
        f"{budget.interplay.text} %.",
        f"In order, the {LARGEST} largest {verdict}: "
        + "; ".join(f"{told}: {', '.join(order) or 'none'}" for told, order in orders.items())
        + ("." if agree else f". {WHY_NOT}"),
    ]


def _rows(budget: Budget) -> list[list[str]]:
    by_source = {c.source: c for c in budget.contributions}
    return [
        [
            source, c.alone.text, c.added.text, c.all_but.text, c.saved.text, c.first.text,
            c.total.text,
        ]
        for source, c in ((source, by_source[source]) for source in _ordered(budget))
    ]  # fmt: skip


def _groups(budgets: Mapping[str, Budget], scans: Scans) -> str:
    """How much the indices stand on."""
    of_all = len(scans.sets[FIRST])
    told = "; ".join(f"{b.groups} of {of_all} for {MEASURES[m][0]}" for m, b in budgets.items())
    return (
        "Indices take groups of scans of which every single one ended well, and so hold for the "
        f"breasts that can be scanned: {told}."
    )


def _outcomes(frame: pl.DataFrame, scans: Scans) -> list[list[str]]:
    """How the scans of each set ended; those of the indices together."""
    joined: dict[str, list[int]] = {}
    for name, numbers in scans.sets.items():
        joined.setdefault(OF_INDICES if _is_of_indices(name) else name, []).extend(numbers)
    well, refused = frame["error"].is_null().to_numpy(), frame["refused"].to_numpy()
    return [
        [name, *map(str, (len(n), well[n].sum(), refused[n].sum(), (~well & ~refused)[n].sum()))]
        for name, n in joined.items()
    ]


def _is_of_indices(name: str) -> bool:
    return name in (FIRST, SECOND) or name.startswith(exchanged(""))


def _causes(frame: pl.DataFrame) -> list[list[str]]:
    failed = frame.filter(pl.col("error").is_not_null()).group_by("cause").agg(
        pl.len(), pl.col("refused").sum()
    )  # fmt: skip
    ordered = failed.sort(["len", "cause"], descending=[True, False])
    return [[str(value) for value in row] for row in ordered.iter_rows()]


def _estimates(budgets: Mapping[str, Budget]) -> pl.DataFrame:
    """All shares, a row each."""
    found = [
        (metric, c.source, view, getattr(c, view))
        for metric, budget in budgets.items()
        for c in budget.contributions
        for view in SHARES
    ]
    found += [
        (metric, None, view, getattr(budget, view))
        for metric, budget in budgets.items()
        for view in (*REMAINDERS, "interplay")
    ]
    rows = [(*names, e.value, e.interval.low, e.interval.high) for *names, e in found]
    columns = ["error", "source", "share_of", "value", "low", "high"]
    return pl.DataFrame(rows, schema=columns, orient="row", infer_schema_length=None)


def _page(parts: Sequence[Part], drawn: Figure, settings: dict[str, Any]) -> str:
    header = (
        f"<header>\n<h1>{TITLE}</h1>\n{html.paragraph(INTRODUCTION)}\n"
        f"{html.pairs(origin.of(settings))}\n</header>"
    )
    sections = [
        html.section(
            part.heading,
            *map(html.paragraph, part.sentences),
            html.table(part.header, part.rows, range(1, len(part.header))),
        )
        for part in parts
    ]
    return html.document(TITLE, [header, html.drawing(drawn, SHOWN, SHOWN), *sections])


def _markdown(parts: Sequence[Part]) -> Iterator[str]:
    yield f"# {TITLE}\n\n{INTRODUCTION}\n\n![Shares of each source](budget.png)\n\n{SHOWN}\n"
    for part in parts:
        yield f"## {part.heading}\n"
        yield from (f"{sentence}\n" for sentence in part.sentences)
        yield f"| {' | '.join(part.header)} |"
        yield "|" + "---|" * len(part.header)
        yield from (f"| {' | '.join(row)} |" for row in part.rows)
        yield ""
