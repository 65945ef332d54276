"""Contact over time: force, indentation of the tissue, tilt of the probe."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.run.trajectory import MM_PER_M, Trajectory

STRETCHES = 700
"""Stretches of time over each of which the measured force is drawn as one range: about two pixels
of the page."""
SETTLING_TIME = 1.0
"""Time after the start of the loop from which the force counts [s]."""


def contact_force(trajectory: Trajectory, set_point: float | None) -> Figure:
    """Force along the probe axis, measured and, where known, true: the whole scan, then the settled
    loop enlarged.

    Args:
        trajectory: The log.
        set_point: Force that the controller holds over the loop [N]; None where it is not known.
    """
    settled = _settled(trajectory)
    rows = 2 if settled.any() else 1
    figure, axes = theme.panels(rows, 1, height_in=2.8 * rows)
    whole = axes[0, 0]
    _draw_force(whole, trajectory, np.full(len(trajectory.elapsed), True), set_point)
    theme.shade_phases(whole, trajectory.spans())
    theme.title(whole, "Whole scan")
    theme.legend_above(whole)
    if settled.any():
        _draw_force(axes[1, 0], trajectory, settled, set_point)
        axes[1, 0].set_xlim(*trajectory.elapsed[settled][[0, -1]])
        theme.title(axes[1, 0], f"Loop from {SETTLING_TIME:g} s after its start, enlarged")
    return figure


def indentation(trajectory: Trajectory) -> Figure | None:
    """True indentation of the tissue and tilt of the probe; None where the log holds no truth."""
    signals = [
        (trajectory.true_depth, MM_PER_M, "indentation [mm]"),
        (trajectory.true_tilt, np.rad2deg(1.0), "tilt [°]"),
    ]
    known = [(values * scale, label) for values, scale, label in signals if values is not None]
    if not known:
        return None
    figure, axes = theme.panels(len(known), 1, height_in=2.2 * len(known), sharex=True)
    for index, (axis, (values, label)) in enumerate(zip(axes[:, 0], known, strict=True)):
        axis.plot(trajectory.elapsed, values, **theme.TRUTH_LINE)
        theme.shade_phases(axis, trajectory.spans(), named=index == 0)
        axis.set_ylabel(label)
    axes[-1, 0].set_xlabel("time [s]")
    figure.align_ylabels(axes[:, 0])
    return figure


def envelope(
    t: Float[np.ndarray, "n"], values: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Start, least and greatest value of each of at most `STRETCHES` stretches, so that no peak
    is lost.
    """
    length = -(-len(t) // STRETCHES)
    starts = np.arange(0, len(t), length)
    return t[starts], np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)


def _draw_force(
    axis: Axes, trajectory: Trajectory, shown: Bool[np.ndarray, "n"], set_point: float | None
) -> None:
    time, lowest, highest = envelope(trajectory.elapsed[shown], trajectory.pressing_force[shown])
    axis.fill_between(
        time, lowest, highest, color=theme.MEASURED, alpha=0.45, linewidth=0.6, label="measured"
    )
    if trajectory.true_force is not None:
        axis.plot(
            trajectory.elapsed[shown],
            trajectory.true_force[shown],
            **theme.TRUTH_LINE,
            label="true",
        )
    if set_point is not None and trajectory.has_loop:
        held = trajectory.elapsed[trajectory.in_loop & shown][[0, -1]]
        axis.plot(held, np.full(2, set_point), **theme.PLANNED_LINE, label="set-point")
    axis.set(xlabel="time [s]", ylabel="pressing force [N]")


def _settled(trajectory: Trajectory) -> Bool[np.ndarray, "n"]:
    """The samples of the loop from `SETTLING_TIME` after its start."""
    if not trajectory.has_loop:
        return trajectory.in_loop
    start = trajectory.elapsed[trajectory.in_loop][0]
    return trajectory.in_loop & (trajectory.elapsed >= start + SETTLING_TIME)
