"""How arm and wrist sensor behave, drawn: servoj's responses, energy, arms that deviate, and what
sensors read.
"""

from pathlib import Path

import numpy as np
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

COLOURS = ("#0072b2", "#009e73", "#e69f00", "#d55e00")
"""Of the members of a family, from Okabe and Ito's palette."""
SHOWN_SETTINGS = ((0.03, 2000.0), (0.1, 2000.0), (0.1, 300.0), (0.03, 300.0))
"""Lookahead [s] and gain whose steps are drawn."""
SHOWN_TIME = 0.5
"""[s]"""
JOINT = 1
"""The shoulder, which carries most."""
DPI = 100


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
        figure.savefig(folder / f"{name}.png", dpi=DPI, facecolor="white")
    return list(figures)


def _servo(responses: list[Response]) -> Figure:
    figure, axes = theme.panels(1, 2, height_in=3.4)
    step, lag = axes[0]
    for colour, setting in zip(COLOURS, SHOWN_SETTINGS, strict=True):
        response = next(r for r in responses if (r.config.lookahead_time, r.config.gain) == setting)
        milliseconds = 1e3 * PERIOD * np.arange(len(response.law))
        shown = milliseconds < 1e3 * SHOWN_TIME
        step.plot(milliseconds[shown], response.step[shown, JOINT], color=colour, linewidth=1.6,
                  label=f"{setting[0]:g} s, {setting[1]:.0f}")  # fmt: skip
        step.plot(milliseconds[shown], response.law[shown], **theme.PLANNED_LINE)
    step.set(xlabel="time [ms]", ylabel="fraction of the step", ylim=(-0.05, 1.65))
    step.legend(frameon=False, fontsize=8.5, title="lookahead, gain", title_fontsize=8.5)
    theme.title(step, f"A step of {STEP} rad; dashed: what servoj asks for")
    for colour, gain in zip(COLOURS, GAINS, strict=True):
        of_gain = [r for r in responses if r.config.gain == gain]
        times = [1e3 * r.config.lookahead_time for r in of_gain]
        lag.plot(times, [1e3 * r.ramp_lag[JOINT] for r in of_gain], "o", color=colour, markersize=5)
        lag.plot(
            times,
            [1e3 * r.half_time[JOINT] for r in of_gain],
            "s-",
            color=colour,
            markersize=4,
            linewidth=1,
            label=f"{gain:.0f}",
        )
    nominal = [1e3 * ServoConfig(lookahead_time=time).servo.lag for time in LOOKAHEADS]
    lag.plot([1e3 * time for time in LOOKAHEADS], nominal, **theme.PLANNED_LINE)
    lag.set(xlabel="lookahead time [ms]", ylabel="[ms]")
    lag.legend(frameon=False, fontsize=8.5, title="gain", title_fontsize=8.5)
    theme.title(lag, "Lag on a ramp (dots, dashed: the law), half of a step (squares)")
    return figure


def _arm(swings: dict[str, Swing], arms: dict[str, Accuracy]) -> Figure:
    figure, axes = theme.panels(1, 2, height_in=3.2)
    energy, tip = axes[0]
    for colour, (name, swing) in zip(COLOURS, swings.items(), strict=False):
        energy.semilogy(
            swing.time[1:],
            np.maximum(np.abs(swing.drift[1:]), 1e-14),
            color=colour,
            linewidth=1.1,
            label=name,
        )
    energy.axhline(1e-4, **theme.PLANNED_LINE)
    energy.set(xlabel="time [s]", ylabel="|drift| / largest kinetic energy", ylim=(1e-14, 1))
    energy.legend(frameon=False, fontsize=8.5, loc="center")
    theme.title(energy, "Energy of the arm, let go without friction")
    for colour, (name, accuracy) in zip(COLOURS, arms.items(), strict=False):
        of_arms = np.sort(1e3 * accuracy.position.mean(axis=1))
        tip.step(
            of_arms,
            np.arange(1, len(of_arms) + 1) / len(of_arms),
            where="post",
            color=colour,
            linewidth=1.6,
            label=f"calibration {name}",
        )
    tip.set(
        xlabel="mean distance of the true tip from the planned one [mm]",
        ylabel="fraction of the arms",
        xscale="log",
    )
    tip.set_xticks([0.1, 0.2, 0.5, 1, 2], ["0.1", "0.2", "0.5", "1", "2"])
    tip.legend(frameon=False, fontsize=8.5, loc="center")
    theme.title(tip, f"{len(next(iter(arms.values())).position)} arms around the loop")
    return figure


def _wrist(sensors: list[Readings]) -> Figure:
    figure, axes = theme.panels(2, 2, height_in=5.6)
    (drift, spectrum), (tilt, shake) = axes
    for colour, one in zip(COLOURS, sensors, strict=False):
        each_second = one.wait.reshape(-1, round(1.0 / PERIOD), 3).mean(axis=1)
        drift.plot(
            np.arange(len(each_second)),
            np.linalg.norm(each_second, axis=1),
            color=colour,
            linewidth=1.4,
            label=one.quality,
        )
        tilt.step(
            np.sort(one.tilted),
            np.arange(1, len(one.tilted) + 1) / len(one.tilted),
            where="post",
            color=colour,
            linewidth=1.6,
            label=one.quality,
        )
        shake.plot(
            PERIOD * np.arange(len(one.shaken)),
            one.shaken,
            color=colour,
            linewidth=1.0,
            label=one.quality,
        )
        errors = WRENCH_CLASSES[one.quality]
        if errors.force_noise == 0:
            continue
        spectrum.loglog(
            one.frequency[2:-1], one.density[2:-1], color=colour, linewidth=1.3, label=one.quality
        )
        spectrum.loglog(
            one.frequency[2:-1],
            _expected(one.frequency[2:-1], errors.force_noise, errors.bandwidth),
            **theme.PLANNED_LINE,
        )
    shake.plot(
        PERIOD * np.arange(len(sensors[0].inertia)), sensors[0].inertia, **theme.PLANNED_LINE
    )
    drift.set(xlabel="time since the tare [s]", ylabel="force, mean of 1 s [N]")
    spectrum.set(xlabel="frequency [Hz]", ylabel="noise [N²/Hz]")
    tilt.set(xlabel="force read, nothing touching [N]", ylabel="fraction of the poses")
    shake.set(xlabel="time [s]", ylabel="force read [N]", ylim=(-0.05, 1.5))
    for axis, text in (
        (drift, "Left alone"),
        (spectrum, "Noise of a component; dashed: the class's"),
        (tilt, "Tilted by up to 50° after the tare, no noise"),
        (shake, "Shaken in the air; dashed: what the tool's inertia takes"),
    ):
        axis.legend(frameon=False, fontsize=8.5, ncols=3 if axis is shake else 1)
        theme.title(axis, text)
    return figure


def _expected(frequency: np.ndarray, rms: float, bandwidth: float) -> np.ndarray:
    """One-sided density of low-passed white noise whose total power is `rms` squared [N^2/Hz]."""
    pole = low_pass_pole(bandwidth)
    gain = 1 / np.abs(1 - pole * np.exp(-2j * np.pi * frequency * PERIOD)) ** 2
    return rms**2 * 2 * PERIOD * (1 - pole**2) * gain
