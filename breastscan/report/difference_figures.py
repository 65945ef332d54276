"""Figures of two scans side by side, over the path length."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.report.difference import Difference

FIRST_LINE = {**theme.FAMILY[0].line, "linewidth": 1.0}
SECOND_LINE = {**theme.FAMILY[1].line, "linewidth": 1.0}
DIFFERENCE_LINE = {"color": theme.PLANNED, "linewidth": 1.0}
PATH_LABEL = "path length [mm]"
SMALLEST_RANGE = 1e-6
"""Range of the vertical axis below which a difference is drawn as none, in the unit of the axis."""


def write(folder: Path, found: Difference, names: tuple[str, str]) -> None:
    """Draw joints.png, tip.png and force.png."""
    for name, figure in (
        ("joints", joints(found)),
        ("tip", tip(found)),
        ("force", force(found, names)),
    ):
        theme.write_png(figure, folder / f"{name}.png")


def joints(found: Difference) -> Figure:
    """The difference of each joint [deg]."""
    figure, axes = theme.panels(3, 2, height_in=6.0, sharex=True)
    for joint, axis in enumerate(axes.T.flat):
        _draw(axis, found, found.q_deg[:, joint], f"joint {joint + 1} [°]")
    theme.title(axes[0, 0], "Joint angles, second minus first run")
    _finish(figure, axes)
    return figure


def tip(found: Difference) -> Figure:
    """The difference of the tip in B, along and across the normal [mm], and of the probe's
    orientation [deg].
    """
    figure, axes = theme.panels(3, 2, height_in=6.0, sharex=True)
    for axis, index, name in zip(axes[:, 0], range(3), "xyz", strict=True):
        _draw(axis, found, found.tip_mm[:, index], f"{name} in B [mm]")
    _draw(axes[0, 1], found, found.normal_mm, "along the normal [mm]")
    _draw(axes[1, 1], found, found.across_mm, "across it [mm]")
    axes[1, 1].plot(found.s_mm, found.plan_mm, **theme.PLANNED_LINE, label="distance of the plans")
    theme.legend_above(axes[1, 1])
    _draw(axes[2, 1], found, found.turn_deg, "orientation [°]")
    theme.title(axes[0, 0], "Executed tip, second minus first run")
    _finish(figure, axes)
    return figure


def force(found: Difference, names: tuple[str, str]) -> Figure:
    """Pressing force of both runs and its difference [N], and how much later the second run
    comes to a place [s].
    """
    figure, axes = theme.panels(3, 1, height_in=6.6, sharex=True)
    both, apart, later = axes[:, 0]
    both.plot(found.s_mm, found.first.pressing_force, **FIRST_LINE, label=names[0])
    both.plot(found.s_mm, found.second.pressing_force, **SECOND_LINE, label=names[1])
    both.set_ylabel("measured force [N]")
    theme.title(both, "Pressing force")
    theme.legend_above(both)
    _draw(apart, found, found.force, "difference [N]", "measured")
    if found.true_force is not None:
        apart.plot(found.s_mm, found.true_force, **theme.TRUTH_LINE, label="true")
    theme.legend_above(apart)
    _draw(later, found, found.time, "second comes later by [s]")
    _finish(figure, axes)
    return figure


def _draw(axis: Axes, found: Difference, values: np.ndarray, label: str, named: str = "") -> None:
    axis.axhline(0.0, color=theme.MUTED, linewidth=0.8)
    axis.plot(found.s_mm, values, **DIFFERENCE_LINE, label=named)
    axis.set_ylabel(label)
    axis.margins(y=0.1)
    if np.abs(values).max() < SMALLEST_RANGE:
        axis.set_ylim(-1.0, 1.0)


def _finish(figure: Figure, axes: np.ndarray) -> None:
    """One range and one name for the path length, which all panels share."""
    for axis in axes[-1]:
        axis.set_xlabel(PATH_LABEL)
    for column in axes.T:
        figure.align_ylabels(list(column))
    for axis in axes.flat:
        axis.margins(x=0.0)
