"""What a sweep's data set measures: its columns with their plain names, units and worse ends."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import polars as pl

from breastscan.errors import ConfigError
from breastscan.report.catalogue import CATALOGUE, Metric
from breastscan.run.bars import SCAN, Bar, bars_of

BOOKKEEPING = (
    "run", "design", "seed", "error", "cause", "touched", "refused", "success", "version",
    "commit", "picture", "command",
)  # fmt: skip
"""Columns that say which run it was and how it ended; all other numbers are measured, or varied."""
REQUIRED = ("run", "design", "error", "refused")
"""Columns without which there is no report."""
TEXTS = ("error", "cause", "picture", "command")
"""Columns of texts, each of which may be missing in all runs."""
TRUTHS = ("touched", "refused")
"""Columns of what is so or not, and not so where nothing is said."""
NOTHING = "none"
"""What stands for a word that was not given."""
UNITS = {"_mm": "mm", "_m": "m", "_deg": "°", "_n": "N", "_s": "s", "_pct": "%", "_px": "px"}
"""Of a quantity that the catalogue does not know, by the end of its name."""

LISTED = re.compile(r" \([^)]*\)$")
"""What the entries of a list are, at the end of its name."""

Side = Literal["high", "low"]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """How one column of numbers is shown."""

    key: str
    label: str
    unit: str = ""
    scale: float = 1.0
    """Shown unit over stored unit."""
    worse: Side = "high"
    """Which end nobody wants."""
    bar: Bar | None = None
    """What every scan is held to."""

    @property
    def title(self) -> str:
        """Its name with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


SUCCESS = Quantity(key="success", label="share of successful runs", worse="low")
"""1 where a run succeeded, else 0."""

MAIN: dict[str, tuple[str, Side]] = {
    "executed_truth_rms_mm": ("error to the true loop", "high"),
    "force_rmse_n": ("force error, RMS", "high"),
    "force_any_peak_n": ("highest force on the body", "high"),
    "surface_rmse_mm": ("surface error, RMS", "high"),
    "surface_density": ("skin with points", "low"),
    "normal_tilt_mean_deg": ("mean probe tilt", "high"),
    "contact_fraction": ("loop time in contact", "low"),
    "clearance_body_min_mm": ("clearance to the body", "low"),
}
"""The metrics that the page is about, in the order in which they are shown: a short name, and
which end nobody wants."""


def quantity_of(column: str) -> Quantity:
    """How a column is shown; an entry of a list or of a table, as `wall_s_plan`, by the whole."""
    bar = bars_of(SCAN).get(column)
    metric = _owner(column)
    if metric is None:
        unit = next((unit for end, unit in UNITS.items() if column.endswith(end)), "")
        return Quantity(key=column, label=column, unit=unit, bar=bar)
    label, entry = metric.label, column.removeprefix(metric.key).removeprefix("_")
    if entry:
        label = f"{LISTED.sub('', label)}, {entry}"
    return Quantity(key=column, label=label, unit=metric.unit, scale=metric.scale, bar=bar)


def _owner(column: str) -> Metric | None:
    """The metric that a column holds, or holds an entry of."""
    return next((m for m in CATALOGUE if f"{column}_".startswith(f"{m.key}_")), None)


def measured(frame: pl.DataFrame, varied: Sequence[str]) -> list[Quantity]:
    """Every number that any run measured, in the catalogue's order; then those it does not know."""
    columns = [
        name
        for name, kind in frame.schema.items()
        if kind.is_numeric()
        and name not in (*BOOKKEEPING, *varied)
        and frame.select(finite(pl.col(name)).is_not_null().any()).item()
    ]
    order = [metric.key for metric in CATALOGUE]

    def place(column: str) -> int:
        metric = _owner(column)
        return order.index(metric.key) if metric else len(order)

    return [quantity_of(column) for column in sorted(columns, key=place)]


def main_quantities(found: Sequence[Quantity]) -> list[Quantity]:
    """Those of `MAIN` among what was measured, in its order and under its short names."""
    by_key = {quantity.key: quantity for quantity in found}
    return [
        replace(by_key[key], label=label, worse=worse)
        for key, (label, worse) in MAIN.items()
        if key in by_key
    ]


def prepared(frame: pl.DataFrame, varied: Sequence[str]) -> pl.DataFrame:
    """The data set with its numbers in shown units, what is not finite as null, `success` as 0
    or 1 in every row, and what was varied as numbers or as words.

    Raises:
        ConfigError: It holds no run, or lacks a column.
    """
    lacking = [name for name in (*REQUIRED, *varied) if name not in frame.columns]
    if lacking or frame.is_empty():
        raise ConfigError(
            f"the data set {'lacks ' + ', '.join(lacking) if lacking else 'holds no run'}: it "
            f"should hold a row a run, with {', '.join((*REQUIRED, *varied))}; sweep again",
            lacking,
        )
    without_error = pl.col("error").is_null()
    succeeded = (
        pl.col("success").fill_null(without_error) if "success" in frame.columns else without_error
    )
    told, found = ([name for name in names if name in frame.columns] for names in (TEXTS, TRUTHS))
    words = [name for name in varied if not frame.schema[name].is_numeric()]
    return frame.with_columns(
        succeeded.cast(pl.Float64).alias("success"),
        pl.col(found).cast(pl.Boolean).fill_null(False),
        pl.col(told).cast(pl.String),
        *(_words(frame[name]) for name in words),
        *(finite(pl.col(name)) for name in varied if name not in words),
        *(finite(pl.col(quantity.key)) * quantity.scale for quantity in measured(frame, varied)),
    )


def _words(values: pl.Series) -> pl.Series:
    """Each value as it is written, lists as well."""
    written = [NOTHING if value is None else str(value) for value in values.to_list()]
    return pl.Series(values.name, written)


def finite(column: pl.Expr) -> pl.Expr:
    """Numbers as floats, null where they are not finite."""
    numbers = column.cast(pl.Float64)
    return pl.when(numbers.is_finite()).then(numbers)
