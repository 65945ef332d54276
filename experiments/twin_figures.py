"""How arm and wrist sensor behave, drawn: servoj's responses, energy, arms that deviate, and what
sensors read.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.robot.ur.ur5e import PERIOD
from experiments.arm_accuracy import Accuracy
from experiments.free_swing import Swing
from experiments.servo_response import GAINS, LOOKAHEADS, STEP, Response
from experiments.wrist_readings import Readings
from sim.arm.servo import ServoConfig
from sim.wrist.wrench_errors import WRENCH_CLASSES
from sim.wrist.wrench_sensor import low_pass_pole

SHOWN_SETTINGS = ((0.03, 2000.0), (0.1, 2000.0), (0.1, 300.0), (0.03, 300.0))
"""Lookahead [s] and gain whose steps are drawn."""
SHOWN_TIME = 0.5
"""[s]"""
JOINT = 1
"""The shoulder, which carries most."""


def write(
    folder: Path,
    responses: list[Response],
    swings: dict[str, Swing],
    arms: dict[str, Accuracy],
    sensors: list[Readings],
) -> list[str]:
    """Write all figures as PNG; their names, without the ending."""
    figures = {
        "twin_servo": _servo(responses),
        "twin_arm": _arm(swings, arms),
        "twin_wrist": _wrist(sensors),
    }
    for name, figure in figures.items():
        theme.write_png(figure, folder / f"{name}.png")
    return list(figures)


def _servo(responses: list[Response]) -> Figure:
    figure, axes = theme.panels(1, 2, height_in=4.4)
    step, lag = axes[0]
    _draw_steps(step, responses)
    _draw_lags(lag, responses)
    return figure


def _draw_steps(axis: Axes, responses: list[Response]) -> None:
    for look, setting in zip(theme.FAMILY, SHOWN_SETTINGS, strict=False):
        response = next(r for r in responses if (r.config.lookahead_time, r.config.gain) == setting)
        milliseconds = 1e3 * PERIOD * np.arange(len(response.law))
        shown = milliseconds < 1e3 * SHOWN_TIME
        axis.plot(milliseconds[shown], response.law[shown], **look.band)
        axis.plot(
            milliseconds[shown],
            response.step[shown, JOINT],
            **look.line,
            linewidth=1.4,
            label=f"{setting[0]:g} s, {setting[1]:.0f}",
        )
    axis.set(xlabel="time [ms]", ylabel="share of the step [-]", ylim=(-0.05, 1.65))
    theme.legend_under(axis, 2, "lookahead, gain; pale bands: what servoj requests")
    theme.title(axis, f"A step of {STEP} rad")


def _draw_lags(axis: Axes, responses: list[Response]) -> None:
    nominal = [1e3 * ServoConfig(lookahead_time=time).servo.lag for time in LOOKAHEADS]
    lookaheads = [1e3 * time for time in LOOKAHEADS]
    axis.plot(lookaheads, nominal, **theme.PLANNED_LINE, label="ramp, the law")
    ramps = [(1e3 * r.config.lookahead_time, 1e3 * r.ramp_lag[JOINT]) for r in responses]
    axis.plot(*np.transpose(ramps), "o", color=theme.INK, markersize=7, fillstyle="none",
              label="ramp, every gain")  # fmt: skip
    for look, gain in zip(theme.FAMILY, GAINS, strict=False):
        of_gain = [r for r in responses if r.config.gain == gain]
        axis.plot(
            [1e3 * r.config.lookahead_time for r in of_gain],
            [1e3 * r.half_time[JOINT] for r in of_gain],
            **look.line,
            marker=look.marker,
            markersize=4,
            linewidth=1.2,
            label=f"step, gain {gain:.0f}",
        )
    axis.set(xlabel="lookahead time [ms]", ylabel="time [ms]")
    theme.legend_under(axis, 2)
    theme.title(axis, "Lag on a ramp, and time to half of a step")


def _arm(swings: dict[str, Swing], arms: dict[str, Accuracy]) -> Figure:
    figure, axes = theme.panels(1, 2, height_in=3.8)
    energy, tip = axes[0]
    for look, (name, swing) in zip(theme.FAMILY, swings.items(), strict=False):
        drift = np.maximum(np.abs(swing.drift[1:]), 1e-14)
        energy.semilogy(swing.time[1:], drift, **look.line, linewidth=1.2, label=name)
    energy.axhline(1e-4, color=theme.MUTED, linewidth=0.8, label="1e-4")
    energy.set(xlabel="time [s]", ylabel="|drift| / largest kinetic energy [-]", ylim=(1e-14, 1))
    theme.legend_under(energy, 2)
    theme.title(energy, "Energy of the arm, let go without friction")
    for look, (name, accuracy) in zip(theme.FAMILY, arms.items(), strict=False):
        _draw_shares(tip, 1e3 * accuracy.position.mean(axis=1), look, f"calibration {name}")
    tip.set(
        xlabel="mean distance of the true tip from the planned one [mm]",
        ylabel="fraction of the arms [-]",
        xscale="log",
    )
    tip.set_xticks([0.1, 0.2, 0.5, 1, 2], ["0.1", "0.2", "0.5", "1", "2"])
    theme.legend_under(tip, 2)
    theme.title(tip, f"{len(next(iter(arms.values())).position)} arms around the loop")
    return figure


def _wrist(sensors: list[Readings]) -> Figure:
    figure, axes = theme.panels(2, 2, height_in=5.8)
    (drift, spectrum), (tilt, shake) = axes
    for look, one in zip(theme.FAMILY, sensors, strict=False):
        each_second = one.wait.reshape(-1, round(1.0 / PERIOD), 3).mean(axis=1)
        force = np.linalg.norm(each_second, axis=1)
        drift.plot(force, **look.line, linewidth=1.4, label=one.quality)
        _draw_shares(tilt, one.tilted, look, one.quality)
        _draw_spectrum(spectrum, one, look)
    for look, one in reversed(list(zip(theme.FAMILY, sensors, strict=False))):
        # noise is drawn as the solid area that it is, the widest undermost
        shake.plot(PERIOD * np.arange(len(one.shaken)), one.shaken, color=look.color, linewidth=0.9)
    (inertia,) = shake.plot(
        PERIOD * np.arange(len(sensors[0].inertia)),
        sensors[0].inertia,
        **theme.PLANNED_LINE,
        label="reference: the class's noise, the tool's inertia",
    )
    drift.set(xlabel="time since the tare [s]", ylabel="force, mean of 1 s [N]")
    spectrum.set(xlabel="frequency [Hz]", ylabel="noise [N²/Hz]")
    tilt.set(xlabel="force read, nothing touching [N]", ylabel="fraction of the poses [-]")
    shake.set(xlabel="time [s]", ylabel="force read [N]")
    for axis, text in (
        (drift, "Left alone"),
        (spectrum, "Noise of a component"),
        (tilt, "Tilted by up to 50° after the tare, no noise"),
        (shake, "Shaken in the air"),
    ):
        theme.title(axis, text)
    theme.legend_below(figure, [*drift.get_lines(), inertia], 4)
    return figure


def _draw_spectrum(axis: Axes, one: Readings, look: theme.Look) -> None:
    """The noise of a sensor that has any, and what its class is set to."""
    errors = WRENCH_CLASSES[one.quality]
    if errors.force_noise == 0:
        return
    frequency = one.frequency[2:-1]
    axis.loglog(frequency, one.density[2:-1], **look.line, linewidth=1.3)
    expected = _expected(frequency, errors.force_noise, errors.bandwidth)
    axis.loglog(frequency, expected, **theme.PLANNED_LINE)


def _draw_shares(axis: Axes, values: np.ndarray, look: theme.Look, label: str) -> None:
    """Which share of the values is no larger."""
    share = np.arange(1, len(values) + 1) / len(values)
    axis.step(np.sort(values), share, where="post", **look.line, linewidth=1.6, label=label)


def _expected(frequency: np.ndarray, rms: float, bandwidth: float) -> np.ndarray:
    """One-sided density of low-passed white noise whose total power is `rms` squared [N^2/Hz]."""
    pole = low_pass_pole(bandwidth)
    gain = 1 / np.abs(1 - pole * np.exp(-2j * np.pi * frequency * PERIOD)) ** 2
    return rms**2 * 2 * PERIOD * (1 - pole**2) * gain
