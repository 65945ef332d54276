"""Figures of the study of force laws."""

from pathlib import Path
from typing import get_args

import numpy as np
import scipy.signal
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from breastscan.report import theme
from experiments.force_cell import Outcome
from sim.arm.servo import PERIOD
from sim.wrist.wrench_errors import Quality

SHOWN = ("nominal", "breathing, sine", "10 mm nearer", "inclusion")
"""Circumstances whose forces are drawn."""
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
    figure, axes = theme.panels(len(SHOWN), 1, height_in=9.0, sharex=True)
    for axis, name in zip(axes[:, 0], SHOWN, strict=True):
        for look, (law, outcome) in zip(theme.FAMILY, factors[name].items(), strict=True):
            time = 1.0 + PERIOD * np.arange(len(outcome.trace))
            axis.plot(time, outcome.trace, **look.line, linewidth=1.0, label=law)
        axis.set_ylabel("force error [N]")
        theme.title(axis, name)
    axes[-1, 0].set_xlabel("time since the loop began [s]")
    theme.legend_below(figure, axes[0, 0].get_lines(), len(theme.FAMILY))
    theme.write_png(figure, path)


def _draw_factors(path: Path, factors: Rows) -> None:
    figure, ((axis,),) = theme.panels(1, 1, height_in=6.4)
    laws = list(next(iter(factors.values())))
    places = np.arange(len(factors))
    for number, (look, law) in enumerate(zip(theme.FAMILY, laws, strict=True)):
        shift = 0.12 * (number - 0.5 * (len(laws) - 1))
        outcomes = [by_law[law] for by_law in factors.values()]
        axis.plot([o.rmse for o in outcomes], places + shift, **look.dots, markersize=5, label=law)
    axis.set(
        yticks=places,
        yticklabels=list(factors),
        xscale="log",
        xlabel="RMS of the true force error [N]",
    )
    _plain_ticks(axis.xaxis)
    axis.invert_yaxis()
    theme.legend_below(figure, axis.get_lines(), len(laws))
    theme.write_png(figure, path)


def _draw_spectra(path: Path, factors: Rows) -> None:
    figure, axes = theme.panels(1, 2, height_in=4.2, sharey=True)
    for axis, name in zip(axes[0], SHOWN[:2], strict=True):
        for look, (law, outcome) in zip(theme.FAMILY, factors[name].items(), strict=True):
            if len(outcome.trace) >= SEGMENT:
                _draw_spectrum(axis, law, look, outcome.trace)
        axis.set_xlabel("frequency [Hz]")
        theme.title(axis, name)
    axes[0, 0].set_ylabel("force error [N/√Hz]")
    theme.legend_below(figure, axes[0, 0].get_lines(), len(theme.FAMILY))
    theme.write_png(figure, path)


def _draw_spectrum(axis: Axes, law: str, look: theme.Look, trace: np.ndarray) -> None:
    frequency, density = scipy.signal.welch(trace, fs=1.0 / PERIOD, nperseg=SEGMENT)
    axis.loglog(frequency[1:], np.sqrt(density[1:]), **look.line, linewidth=1.0, label=law)


def _draw_hypercube(path: Path, outcomes: list[Outcome]) -> None:
    figure, axes = theme.panels(2, 3, height_in=6.2, sharey=True)
    for axis, (name, (label, scale)) in zip(axes.flat, SCATTERED.items(), strict=True):
        for look, sensor in zip(theme.FAMILY, get_args(Quality), strict=False):
            for inside, fill in ((True, "full"), (False, "none")):
                shown = [o for o in outcomes if o.cell.sensor == sensor and o.inside == inside]
                axis.plot(
                    [scale * getattr(o.cell, name) for o in shown],
                    [o.rmse for o in shown],
                    **look.dots,
                    fillstyle=fill,
                    markersize=4,
                    label=sensor if inside else f"{sensor}, beyond 8 mm",
                )
        axis.set(xlabel=label, yscale="log")
    for axis in axes[:, 0]:
        axis.set_ylabel("RMS force error [N]")
        _plain_ticks(axis.yaxis)
    theme.legend_below(figure, axes[0, 0].get_lines(), 3)
    theme.write_png(figure, path)


def _plain_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at round numbers, written out."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
