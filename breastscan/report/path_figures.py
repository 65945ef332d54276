"""Planned against executed path, and the error between them along the loop."""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.report.paper import table4_statistics
from breastscan.run.trajectory import MM_PER_M, Trajectory

AXES = ("x", "y", "z")
MAGNIFICATIONS = (100.0, 50.0, 20.0, 10.0, 5.0, 2.0)
"""Round factors by which the deviation may be enlarged to be seen."""
LARGEST_SHOWN_DEVIATION = 0.12
"""Share of the loop's extent that the enlarged deviation may take."""
HISTOGRAM_BINS = 30
MOST_NUMBERS = 40
"""Path points that are numbered; more would hide the path."""
LABEL_DISTANCE_PT = 11.0
"""From a path point to its number, clear of the curves."""


def planned_and_executed(path_B: Float[np.ndarray, "k 3"], trajectory: Trajectory) -> Figure:
    """The loop from above and its height, planned and executed [Zhang, Figs. 18, 22].

    Args:
        path_B: Points of the planned path in B [m].
        trajectory: A log that holds a loop.
    """
    loop = trajectory.in_loop
    s_mm = trajectory.s[loop] * MM_PER_M
    planned_mm = trajectory.X_BP_plan[loop, :3, 3] * MM_PER_M
    executed_mm = trajectory.X_BP[loop, :3, 3] * MM_PER_M
    figure, ((top, side),) = theme.panels(1, 2, height_in=4.4, width_ratios=(1.1, 1.0))
    lifted = 1 + np.flatnonzero(np.diff(np.flatnonzero(loop)) > 1)
    _draw_top_view(top, path_B * MM_PER_M, planned_mm, executed_mm, lifted)
    if lifted.size:  # inner strokes leave no room
        theme.legend_below(figure, top.get_lines(), 3)
    else:
        theme.legend_within(top)
    s_mm[lifted] = np.nan
    side.plot(s_mm, planned_mm[:, 2], **theme.PLANNED_LINE)
    side.plot(s_mm, executed_mm[:, 2], **theme.MEASURED_LINE)
    theme.title(side, "Height along the loop")
    side.set(xlabel="path length [mm]", ylabel="z in B [mm]")
    return figure


def deviations(trajectory: Trajectory) -> Figure:
    """What lies between the executed and the planned tip along the path: across the normal the
    tracking error, along it the indentation, and both together in x, y and z; each with its
    histogram [Zhang, Fig. 21].

    Args:
        trajectory: A log that holds a loop.
    """
    s_mm = trajectory.s[trajectory.in_loop] * MM_PER_M
    errors_mm = trajectory.path_errors_mm()
    paper_mm = table4_statistics().mean_abs_mm
    figure, axes = theme.panels(
        5, 2, height_in=7.6, width_ratios=(4, 1), sharex="col", sharey="row"
    )
    _draw_error(axes[0], s_mm, trajectory.tangential_errors_mm(), "error across\nthe normal [mm]")
    _draw_error(axes[1], s_mm, -trajectory.normal_errors_mm(), "indentation\n[mm]")
    for row, (index, name) in zip(axes[2:], enumerate(AXES), strict=True):
        _draw_error(row, s_mm, errors_mm[:, index], f"{name}, with the\nindentation [mm]")
        for line in row:
            line.axhspan(
                -paper_mm[index], paper_mm[index], color=theme.SHADE, linewidth=0, zorder=0
            )
    theme.title(axes[0, 0], "Executed minus planned")
    theme.title(axes[0, 1], "Share of the loop")
    axes[-1, 0].set_xlabel("path length [mm]")
    axes[-1, 1].set_xlabel("share [%]")
    figure.align_ylabels(axes[:, 0])
    return figure


def magnification(deviations: Float[np.ndarray, "n 3"], extent: float) -> float:
    """The largest round factor at which deviations stay small beside the loop's extent (same
    unit); 1 if none does.
    """
    largest = float(np.linalg.norm(deviations, axis=1).max())
    return next(
        (
            factor
            for factor in MAGNIFICATIONS
            if factor * largest <= LARGEST_SHOWN_DEVIATION * extent
        ),
        1.0,
    )


def _draw_top_view(
    axis: Axes,
    points_mm: Float[np.ndarray, "k 3"],
    planned_mm: Float[np.ndarray, "n 3"],
    executed_mm: Float[np.ndarray, "n 3"],
    lifted: Int[np.ndarray, "lifts"],
) -> None:
    """Its lines are broken at rows before which the probe was lifted. Of several strokes, which lie
    beside each other, deviations are not enlarged.
    """
    deviations_mm, factor = executed_mm - planned_mm, 1.0
    if not lifted.size:
        factor = magnification(deviations_mm, extent=float(np.ptp(planned_mm, axis=0).max()))
    shown_mm = planned_mm + factor * deviations_mm
    planned_mm = planned_mm.copy()
    shown_mm[lifted] = planned_mm[lifted] = np.nan
    label = "executed" if factor == 1.0 else f"executed, deviation × {factor:g}"
    axis.plot(planned_mm[:, 0], planned_mm[:, 1], **theme.PLANNED_LINE, label="planned")
    axis.plot(shown_mm[:, 0], shown_mm[:, 1], **theme.MEASURED_LINE, label=label)
    axis.plot(
        points_mm[:, 0], points_mm[:, 1], "o", color=theme.ACCENT, markersize=4, label="path points"
    )
    numbered = points_mm if len(points_mm) <= MOST_NUMBERS else points_mm[:0]
    for number, (x, y, _) in enumerate(numbered, start=1):
        offset = _label_offset(points_mm, number - 1)
        axis.annotate(
            str(number),
            (x, y),
            offset,
            textcoords="offset points",
            ha="center",
            va="center",
            color=theme.MUTED,
            fontsize=7.5,
        )
    theme.title(axis, "From above")
    axis.set(xlabel="x in B [mm]", ylabel="y in B [mm]", aspect="equal")
    axis.margins(0.1)


def _label_offset(points_mm: Float[np.ndarray, "k 3"], index: int) -> tuple[float, float]:
    """Where a point's number stands beside it [pt]: towards the inside of the loop."""
    inwards = (points_mm.mean(axis=0) - points_mm[index])[:2]
    dx, dy = LABEL_DISTANCE_PT * inwards / max(float(np.linalg.norm(inwards)), 1e-9)
    return float(dx), float(dy)


def _draw_error(
    row: np.ndarray, s_mm: Float[np.ndarray, "n"], error_mm: Float[np.ndarray, "n"], label: str
) -> None:
    along, histogram = row
    along.axhline(0.0, color=theme.MUTED, linewidth=0.8)
    along.plot(s_mm, error_mm, **theme.MEASURED_LINE)
    along.set_ylabel(label)
    along.set_xlim(s_mm[0], s_mm[-1])
    along.margins(y=0.1)
    share = np.full(len(error_mm), 100.0 / len(error_mm))
    histogram.hist(
        error_mm,
        bins=HISTOGRAM_BINS,
        range=along.get_ylim(),
        weights=share,
        orientation="horizontal",
        color=theme.MEASURED,
    )
