"""How figures look: one palette that follows the page's light or dark scheme, and SVG that carries
real text.

Figures are drawn in the colours of the light scheme. `to_svg` replaces each of them by the CSS
variable of the same name, which `page.css` defines for both schemes. The series colours are Okabe
and Ito's, safe for colour-blind readers.
"""

import io
import re
from html import escape
from typing import Any

import matplotlib
import numpy as np
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

PLANNED_LINE = {"color": PLANNED, "linewidth": 1.0, "linestyle": (0, (4, 2))}
MEASURED_LINE = {"color": MEASURED, "linewidth": 1.3}
TRUTH_LINE = {"color": TRUTH, "linewidth": 1.1}

NARROW_SPAN = 0.07
"""Share of the time axis below which a phase's name is written upright."""
HEADROOM = 0.18
"""Share of the curve's range that stays free above and below it, for the phases' names."""

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


def legend_within(axis: Axes) -> None:
    """A legend in the middle of the axes, where a closed loop leaves room."""
    axis.legend(loc="center", frameon=False, labelcolor=INK, fontsize=8.5)


def shade_phases(axis: Axes, spans: list[Span], named: bool = True) -> None:
    """Shade every other phase, and write its name along the top edge."""
    start, end = spans[0].start, spans[-1].end
    axis.set_xlim(start, end)
    axis.margins(y=HEADROOM)
    for index, span in enumerate(spans):
        if index % 2 == 0:
            axis.axvspan(span.start, span.end, color=SHADE, linewidth=0, zorder=0)
        if named:
            narrow = span.end - span.start < NARROW_SPAN * (end - start)
            axis.text(
                (span.start + span.end) / 2,
                0.98,
                span.phase,
                transform=axis.get_xaxis_transform(),
                color=MUTED,
                ha="center",
                va="top",
                rotation=90 if narrow else 0,
                fontsize=8,
            )


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
