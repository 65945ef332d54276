"""Figures of the study of force laws."""

from pathlib import Path

import numpy as np
import scipy.signal
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from breastscan.robot.ur.ur5e import PERIOD
from experiments.force_cell import Outcome

SHOWN = ("nominal", "breathing, sine", "10 mm nearer", "inclusion")
"""Circumstances whose forces are drawn."""
DPI = 110
SEGMENT = 1024
"""Samples of a segment of the spectra: 2 s."""
SCATTERED = {
    "young": ("modulus [kPa]", 1e-3),
    "force": ("set-point [N]", 1.0),
    "speed": ("speed [mm/s]", 1e3),
    "amplitude": ("breathing [mm]", 1e3),
    "surface_error": ("surface error [mm]", 1e3),
    "lag": ("servo lag [ms]", 1e3),
}
"""Factors of the hypercube that are drawn, with their unit's scale."""

Rows = dict[str, dict[str, Outcome]]


def write(folder: Path, factors: Rows, hypercube: list[Outcome]) -> dict[str, str]:
    """Draw all; their names and captions."""
    _draw_traces(folder / "force_traces.png", factors)
    _draw_factors(folder / "force_factors.png", factors)
    _draw_spectra(folder / "force_spectra.png", factors)
    _draw_hypercube(folder / "force_hypercube.png", hypercube)
    return {
        "force_traces.png": "Force error over the loop",
        "force_factors.png": "One factor at a time",
        "force_spectra.png": "Spectra of the force error",
        "force_hypercube.png": "All factors at once",
    }


def _draw_traces(path: Path, factors: Rows) -> None:
    figure = Figure(figsize=(10, 9), layout="constrained")
    axes = figure.subplots(len(SHOWN), 1, sharex=True)
    for axis, name in zip(axes, SHOWN, strict=True):
        for law, outcome in factors[name].items():
            axis.plot(
                1.0 + PERIOD * np.arange(len(outcome.trace)), outcome.trace, lw=0.9, label=law
            )
        axis.set(title=name, ylabel="force error [N]")
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=6, fontsize=8)
    axes[-1].set_xlabel("time since the loop began [s]")
    figure.savefig(path, dpi=DPI)


def _draw_factors(path: Path, factors: Rows) -> None:
    figure = Figure(figsize=(9, 6), layout="constrained")
    axis = figure.subplots()
    laws = list(next(iter(factors.values())))
    places = np.arange(len(factors))
    for number, law in enumerate(laws):
        shift = 0.12 * (number - 0.5 * (len(laws) - 1))
        outcomes = [by_law[law] for by_law in factors.values()]
        axis.plot([o.rmse for o in outcomes], places + shift, "o", ms=5, label=law)
    axis.set(
        yticks=places,
        yticklabels=list(factors),
        xscale="log",
        xlabel="RMS of the true force error [N]",
    )
    _plain_ticks(axis.xaxis)
    axis.invert_yaxis()
    axis.grid(alpha=0.3)
    figure.legend(fontsize=8, loc="outside right upper")
    figure.savefig(path, dpi=DPI)


def _draw_spectra(path: Path, factors: Rows) -> None:
    figure = Figure(figsize=(11, 4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, name in zip(axes, SHOWN[:2], strict=True):
        for law, outcome in factors[name].items():
            if len(outcome.trace) >= SEGMENT:
                _draw_spectrum(axis, law, outcome.trace)
        axis.set(title=name, xlabel="frequency [Hz]")
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("force error [N/√Hz]")
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=DPI)


def _draw_spectrum(axis: Axes, law: str, trace: np.ndarray) -> None:
    frequency, density = scipy.signal.welch(trace, fs=1.0 / PERIOD, nperseg=SEGMENT)
    axis.loglog(frequency[1:], np.sqrt(density[1:]), lw=1.0, label=law)


def _draw_hypercube(path: Path, outcomes: list[Outcome]) -> None:
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    axes = figure.subplots(2, 3, sharey=True)
    for axis, (name, (label, scale)) in zip(axes.flat, SCATTERED.items(), strict=True):
        for sensor in dict.fromkeys(o.cell.sensor for o in outcomes):
            for inside, marker in ((True, "o"), (False, "x")):
                shown = [o for o in outcomes if o.cell.sensor == sensor and o.inside == inside]
                where = "" if inside else ", beyond 8 mm"
                axis.plot(
                    [scale * getattr(o.cell, name) for o in shown],
                    [o.rmse for o in shown],
                    marker,
                    ms=4,
                    label=f"{sensor}{where}",
                    color={"ideal": "C0", "industrial": "C1", "ur5e_builtin": "C2"}[sensor],
                )
        axis.set(xlabel=label, yscale="log")
        axis.grid(alpha=0.3, which="both")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS force error [N]")
        _plain_ticks(axis.yaxis)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), fontsize=8, loc="outside upper center", ncols=3
    )
    figure.savefig(path, dpi=DPI)


def _plain_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at round numbers, written out."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
