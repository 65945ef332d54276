"""One figure, table or equation of the paper, and what stands here beside it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from breastscan.report.paper import PUBLISHED
from breastscan.run.columns import Column, Kind

Verdict = Literal["agrees", "better", "worse", "not comparable"]
ILLUSTRATIONS = ("Fig. 1", "Fig. 16", "Fig. 20", "Fig. 23")
"""Schematics and photographs, which claim nothing."""
HEADINGS: tuple[str, ...] = tuple(PUBLISHED["items"])
"""Everything that the paper shows, in the order in which it is read."""

Data = Mapping[Column, np.ndarray]
"""A table, column by column."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """What was found for one of `HEADINGS`."""

    heading: str
    ours: str
    """The counterpart of the paper's statement, with numbers and units."""
    verdict: Verdict
    why: str
    """What the verdict rests on."""
    data: Data
    """What was measured; drawn, if there is a figure."""
    figure: Figure | None = None
    shows: str = ""
    """What is seen in the figure."""

    def __post_init__(self) -> None:
        if self.heading not in HEADINGS:
            raise ValueError(f"the paper has no {self.heading!r}: expected one of {HEADINGS}")

    @property
    def statement(self) -> str:
        """What the paper says."""
        return PUBLISHED["items"][self.heading]["statement"].strip()

    @property
    def correction(self) -> str:
        """Which misprint was set right before the comparison; empty where there is none."""
        return PUBLISHED["items"][self.heading].get("correction", "").strip()

    @property
    def stem(self) -> str:
        """Of its files' names: fig_3, table_1, eq_32."""
        return self.heading.lower().replace(".", "").replace(" ", "_")


def judged(holds: bool, verdict: Verdict) -> Verdict:
    """A verdict that was measured: `verdict` where what it says holds, else "worse"."""
    return verdict if holds else "worse"


def column(
    name: str, meaning: str, unit: str = "", frame: str = "", kind: Kind = "number"
) -> Column:
    """A column of an item's data; the unit stands in its name as well."""
    return Column(name=name, meaning=meaning, unit=unit, frame=frame, kind=kind)


def coordinates(
    name: str, meaning: str, values: np.ndarray, unit: str = "mm", frame: str = "B"
) -> dict[Column, np.ndarray]:
    """Three columns for vectors, one a row; `name` with a place for the axis."""
    return {
        column(name.format(axis), meaning, unit, frame): part
        for axis, part in zip("xyz", values.T, strict=True)
    }
