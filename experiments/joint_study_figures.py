"""What the joints do along a loop, as the paper draws it: all six over time, one column a walk
[Zhang, Fig. 19].
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from breastscan.report import theme
from breastscan.report.joint_figures import JOINTS, SPEED_LIMIT_DEG_S
from breastscan.robot.ur.ur5e import PERIOD
from experiments.joint_walks import Walk

SHOWN = slice(None, None, 20)
"""Samples drawn: every 40 ms."""
MARKED = 60
"""Samples drawn from one marker to the next; each joint's are shifted against the last's."""


def write(folder: Path, walks: list[Walk]) -> list[str]:
    """Write one figure a loop and one of the peaks, as PNG and SVG; their names, without the
    ending.
    """
    figures = {}
    for loop in dict.fromkeys(walk.loop for walk in walks):
        figures["joints_" + loop.replace(",", "").replace(" ", "_")] = over_time(
            [w for w in walks if w.loop == loop]
        )
    figures["joint_speed_peaks"] = speed_peaks(walks)
    for name, figure in figures.items():
        theme.write_png(figure, folder / f"{name}.png")
        figure.savefig(folder / f"{name}.svg", facecolor="white")
    return list(figures)


def over_time(walks: list[Walk]) -> Figure:
    """Angle, speed and acceleration of all joints: the MuJoCo arm's as lines, the planned ones as
    pale bands under them.
    """
    figure, axes = theme.panels(3, len(walks), height_in=7.2, sharex=True, sharey="row")
    for column, walk in zip(axes.T, walks, strict=True):
        theme.title(column[0], walk.name)
        column[-1].set_xlabel("time [s]")
        if walk.planned is None or walk.q is None or walk.qd is None:
            column[0].text(
                0.5,
                0.5,
                _refusal(walk),
                transform=column[0].transAxes,
                ha="center",
                va="center",
                fontsize=8,
                color=theme.MUTED,
            )
            continue
        q_plan = walk.planned.q
        qd_plan = walk.planned.qd
        time = PERIOD * np.arange(len(q_plan))
        rows = (
            (walk.q, q_plan),
            (walk.qd, qd_plan),
            (np.gradient(walk.qd, PERIOD, axis=0), np.gradient(qd_plan, PERIOD, axis=0)),
        )
        for axis, (went, planned) in zip(column, rows, strict=True):
            for joint, look in enumerate(theme.FAMILY):
                axis.plot(time[SHOWN], np.degrees(planned[SHOWN, joint]), **look.band)
                axis.plot(
                    time[SHOWN],
                    np.degrees(went[SHOWN, joint]),
                    **look.line,
                    linewidth=1.1,
                    marker=look.marker,
                    markersize=3.5,
                    markevery=(joint * MARKED // len(theme.FAMILY), MARKED),
                    label=f"joint {JOINTS[joint]}",
                )
    for axis, label in zip(
        axes[:, 0], ("angle [°]", "speed [°/s]", "acceleration [°/s²]"), strict=True
    ):
        axis.set_ylabel(label)
    lines = next(c[0].get_lines()[1::2] for c in axes.T if c[0].get_lines())
    theme.legend_below(figure, lines, len(JOINTS) // 2)
    return figure


def speed_peaks(walks: list[Walk]) -> Figure:
    """The largest speed of each joint in every walk."""
    loops = list(dict.fromkeys(walk.loop for walk in walks))
    figure, axes = theme.panels(1, len(loops), height_in=3.2, sharey=True)
    for axis, loop in zip(axes[0], loops, strict=True):
        of_loop = [walk for walk in walks if walk.loop == loop]
        for place, walk in enumerate(of_loop):
            if walk.qd is None:
                axis.text(
                    place,
                    0.5,
                    "unreachable",
                    rotation=90,
                    ha="center",
                    va="bottom",
                    color=theme.MUTED,
                    fontsize=8,
                )
                continue
            peaks = np.degrees(np.abs(walk.qd).max(axis=0))
            colours = [look.color for look in theme.FAMILY]
            bars = axis.bar(place + 0.13 * (np.arange(6) - 2.5), peaks, width=0.12, color=colours)
            axis.bar_label(bars, ["1", "2", "3", "4", "5", "6"], fontsize=6, color=theme.INK)
        axis.set_xlim(-0.5, len(of_loop) - 0.5)
        axis.set_xticks(
            range(len(of_loop)),
            [walk.name.replace(", ", "\n").replace(" mount", "") for walk in of_loop],
        )
        axis.tick_params(labelsize=8)
        theme.title(axis, loop)
    handles = [
        Patch(color=look.color, label=f"joint {name}")
        for look, name in zip(theme.FAMILY, JOINTS, strict=True)
    ]
    theme.legend_below(figure, handles, len(JOINTS))
    axes[0, 0].set_ylabel(f"largest speed [°/s], limit {SPEED_LIMIT_DEG_S:.0f}")
    return figure


def _refusal(walk: Walk) -> str:
    """Why there are no curves: the first few points that cannot be reached."""
    few = [point.split(" (")[0] for point in walk.unreachable]
    return "no path:\n" + (
        "\n".join([", ".join(few[:6]), ", ".join(few[6:])]) + "\nunreachable"
        if few
        else "see table"
    )
