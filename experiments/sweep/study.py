"""What the page of a sweep is made from: its runs, and what can be said of them."""

from dataclasses import dataclass
from pathlib import Path

import polars as pl

from experiments.sweep.quantities import SUCCESS, Quantity, main_quantities, measured, prepared
from experiments.sweep.statistics import Effect, Summary, effects, summary


@dataclass(frozen=True, kw_only=True)
class Meta:
    """Where a data set comes from."""

    title: str
    """Of the page."""
    varied: tuple[str, ...]
    """Columns of what the sweep varied."""
    version: str
    """Of the package."""
    commit: str | None
    """Of the source tree; None where it is not known."""
    spec: str
    """The file that asked for the sweep, as it was written."""
    pictures: Path
    """Folder that the paths of pictures start from."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """What the sections are made from."""

    frame: pl.DataFrame
    """A row a run, as `prepared` leaves it."""
    meta: Meta
    quantities: list[Quantity]
    """All that was measured."""
    summaries: dict[str, Summary]
    """Of each, by its key."""
    main: list[Quantity]
    """What the page is about."""
    effects: list[Effect]
    """On the main quantities and on success, the strongest first."""

    @property
    def settings(self) -> list[str]:
        """What was varied and does differ, in the order of its strongest effect."""
        acting = dict.fromkeys(effect.setting for effect in self.effects)
        differing = [name for name in self.meta.varied if self.frame[name].n_unique() > 1]
        return [*acting, *(name for name in differing if name not in acting)]

    @property
    def numbers(self) -> list[str]:
        """Those of them that are numbers."""
        return [name for name in self.settings if self.frame.schema[name].is_numeric()]


def study(frame: pl.DataFrame, meta: Meta) -> Study:
    """All that the page shows, measured.

    Raises:
        ConfigError: The data set holds no run, or lacks a column.
    """
    runs, quantities = prepared(frame, meta.varied), measured(frame, meta.varied)
    main = main_quantities(quantities)
    keys = [quantity.key for quantity in (*main, SUCCESS)]
    return Study(
        frame=runs,
        meta=meta,
        quantities=quantities,
        summaries={quantity.key: summary(runs, quantity.key) for quantity in quantities},
        main=main,
        effects=effects(runs, meta.varied, keys),
    )
