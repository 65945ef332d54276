"""How figures look: one palette that follows the page's light or dark scheme, and SVG that carries
real text.

Figures are drawn in the colours of the light scheme. `to_svg` replaces each of them by the CSS
variable of the same name, which `page.css` defines for both schemes. The series colours are Okabe
and Ito's, safe for colour-blind readers; the members of a family differ in line style and marker as
well, so that no reader depends on colour.
"""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.run.trajectory import Span

INK = "#1c2430"
MUTED = "#667085"
GRID = "#e3e7ed"
SHADE = "#eef2f7"
MEASURED = "#0072b2"
TRUTH = "#d55e00"
PLANNED = "#475061"
ACCENT = "#009e73"

YELLOW = "#f0e442"
"""Okabe and Ito's; seen on black, on grey, and on white with a dark edge."""
READABLE_ON_BOTH = "#7a8494"
"""A grey that is legible on the light and on the dark page."""
MEASURED_ON_BOTH = "#2b87cf"
"""The blue of what was measured, between its light and its dark variant."""
PATH_ON_SKIN = "#56b4e9"
"""Okabe and Ito's sky blue, which every reader tells from `SKIN`."""
SKIN = ((0.0, "#7d5546"), (1.0, "#e9b998"))
"""Colours of the lowest and of the highest point of a cloud: neither is taken by a line."""

CSS_VARIABLES = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    SHADE: "--shade",
    MEASURED: "--measured",
    TRUTH: "--truth",
    PLANNED: "--planned",
    ACCENT: "--accent",
}
"""Where the page defines each colour, for its light and its dark scheme."""

WIDTH_IN = 9.6
"""Width of every figure [inch]; the page scales it to the column."""

DOTS_PER_INCH = 110
"""Of figures that are written as PNG."""


@dataclass(frozen=True)
class Look:
    """How one member of a family of curves is told from the others."""

    color: str
    linestyle: str | tuple[int, tuple[float, ...]]
    marker: str

    @property
    def line(self) -> dict[str, Any]:
        """As a line, for `plot`."""
        return {"color": self.color, "linestyle": self.linestyle}

    @property
    def band(self) -> dict[str, Any]:
        """As a pale band under its line: what the line is held against."""
        return {"color": self.color, "linestyle": "-", "linewidth": 3.5, "alpha": 0.25}

    @property
    def dots(self) -> dict[str, Any]:
        """As single markers, for `plot`."""
        return {"color": self.color, "linestyle": "none", "marker": self.marker}


FAMILY = (
    Look("#0072b2", "-", "o"),
    Look("#e69f00", (0, (5, 1.5)), "s"),
    Look("#009e73", (0, (1.2, 1.2)), "^"),
    Look("#d55e00", (0, (6, 1.5, 1.2, 1.5)), "D"),
    Look("#000000", (0, (2.5, 1.5)), "v"),
    Look("#56b4e9", (0, (6, 1.2, 1.2, 1.2, 1.2, 1.2)), "X"),
)
"""Of the members of a family, in their order: Okabe and Ito's colours, the easily confused ones
apart."""

PLANNED_LINE = {"color": PLANNED, "linewidth": 1.0, "linestyle": (0, (4, 2))}
MEASURED_LINE = {"color": MEASURED, "linewidth": 1.3}
TRUTH_LINE = {"color": TRUTH, "linewidth": 1.1}

PHASE_SIZE_PT = 8.0
"""Of the phases' names."""
LETTER_WIDTH = 0.6
"""Of a letter over its size, on average."""
FREE_FRACTION = 0.82
"""Of a panel, inside its axes, ticks and title taken off."""

_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}
_SVG_SETTINGS: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "breastscan"}
_NO_METADATA = {"Creator": None, "Date": None, "Format": None, "Type": None}


def panels(rows: int, columns: int, height_in: float, **options: Any) -> tuple[Figure, np.ndarray]:
    """A figure with `rows` x `columns` dressed axes; `options` go to matplotlib's `subplots`."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained", facecolor="none")
        axes = figure.subplots(rows, columns, squeeze=False, **options)
        for axis in axes.flat:
            axis.grid(color=GRID, linewidth=0.7)
            axis.tick_params(length=3)
    return figure, axes


def title(axis: Axes, text: str) -> None:
    """A title over the left end of the axes."""
    axis.set_title(text, loc="left", color=INK, fontsize=9.5)


def legend_above(axis: Axes) -> None:
    """A legend in one line above the right end of the axes."""
    axis.legend(
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=4,
        frameon=False,
        labelcolor=INK,
        fontsize=8.5,
    )


def legend_below(figure: Figure, lines: Sequence[Artist], columns: int) -> None:
    """A legend under a whole figure."""
    figure.legend(
        handles=lines,
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        labelcolor=INK,
        fontsize=8.5,
        handlelength=2.8,
    )


def legend_under(axis: Axes, columns: int, title: str | None = None) -> None:
    """A legend under the axes, below their label."""
    axis.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.18),
        ncols=columns,
        frameon=False,
        labelcolor=INK,
        fontsize=8.5,
        title=title,
        title_fontsize=8.5,
        handlelength=2.8,
    )


def legend_within(axis: Axes) -> None:
    """A legend in the middle of the axes, where a closed loop leaves room."""
    axis.legend(loc="center", frameon=False, labelcolor=INK, fontsize=8.5)


def shade_phases(axis: Axes, spans: list[Span], named: bool = True) -> None:
    """Shade every other phase of what was drawn, and write its name along the top edge.

    A name that is wider than its phase stands upright; one that would meet the last is left out.
    The axes grow upwards, so that no name lies on a curve.
    """
    start, end = spans[0].start, spans[-1].end
    width_pt, height_pt = _panel_size_pt(axis)
    axis.set_xlim(start, end)
    for span in spans[::2]:
        axis.axvspan(span.start, span.end, color=SHADE, linewidth=0, zorder=0)
    if not named:
        return
    tallest_pt = last_end_pt = 0.0
    for span in spans:
        length_pt = LETTER_WIDTH * PHASE_SIZE_PT * len(span.phase)
        middle_pt = ((span.start + span.end) / 2 - start) / (end - start) * width_pt
        upright = length_pt > (span.end - span.start) / (end - start) * width_pt
        half_pt = 0.5 * (PHASE_SIZE_PT if upright else length_pt)
        if middle_pt - half_pt < last_end_pt - 1.0:
            continue
        last_end_pt = middle_pt + half_pt
        tallest_pt = max(tallest_pt, length_pt if upright else 1.2 * PHASE_SIZE_PT)
        _name_phase(axis, span, rotation=90 if upright else 0)
    low, high = axis.get_ylim()
    share = min(tallest_pt / height_pt, 0.5)
    axis.set_ylim(low, low + (high - low) / (1.0 - share))


def _name_phase(axis: Axes, span: Span, rotation: float) -> None:
    axis.text(
        (span.start + span.end) / 2,
        0.98,
        span.phase,
        transform=axis.get_xaxis_transform(),
        color=MUTED,
        ha="center",
        va="top",
        rotation=rotation,
        fontsize=PHASE_SIZE_PT,
    )


def _panel_size_pt(axis: Axes) -> tuple[float, float]:
    """About the width and height of the axes, which are not laid out yet [pt]."""
    place = axis.get_subplotspec()
    assert place is not None, "axes of `panels` lie in a grid"
    rows, columns = place.get_gridspec().get_geometry()
    figure = axis.get_figure(root=True)
    assert figure is not None, "axes of `panels` lie in a figure"
    width_in, height_in = figure.get_size_inches()
    return 72.0 * FREE_FRACTION * width_in / columns, 72.0 * FREE_FRACTION * height_in / rows


def write_png(figure: Figure, path: Path) -> None:
    """Write a figure on white, in full colour."""
    figure.savefig(path, dpi=DOTS_PER_INCH, facecolor="white")


def write_svg(figure: Figure, path: Path, description: str) -> None:
    """Write a figure in the colours of the light scheme, with `description` for who cannot see
    it.
    """
    svg = to_svg(figure, description)
    for colour, variable in CSS_VARIABLES.items():
        svg = svg.replace(f"var({variable})", colour)
    path.write_text(svg, encoding="utf-8")


def to_svg(figure: Figure, description: str) -> str:
    """Inline SVG that takes its colours and font from the page, with `description` for who
    cannot see it.
    """
    buffer = io.StringIO()
    with matplotlib.rc_context(_SVG_SETTINGS):
        figure.savefig(buffer, format="svg", transparent=True, metadata=_NO_METADATA)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    # matplotlib's names of groups repeat from figure to figure
    svg = re.sub(r'<g id="\w+_\d+">', "<g>", svg)
    svg = re.sub(r' d="[^"]+"', _hundredths, svg)
    for colour, variable in CSS_VARIABLES.items():
        svg = svg.replace(colour, f"var({variable})")
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(description)}"', 1)


def _hundredths(path: re.Match[str]) -> str:
    """A drawn path with its coordinates cut to a hundredth of a point: a third of the size, no
    visible difference.
    """
    return re.sub(r"(\.\d\d)\d+", r"\1", path.group())
