"""Does the twin's arm behave as a UR5e, and its wrist sensor as the one named?

The arm's response to servoj, its energy when let go, its repetition to the last bit, what its
kinematic deviations do to the tip, and what each class of wrist sensor reads.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.execution import execute
from breastscan.planning.motion import Motion
from breastscan.run import writing
from breastscan.run.provenance import provenance
from experiments import arm_accuracy, free_swing, servo_response, twin_figures, wrist_readings
from experiments.arm_accuracy import Accuracy
from experiments.free_swing import Swing
from experiments.sections import section
from experiments.servo_response import Response
from experiments.wrist_readings import Readings
from sim.arm.servo import PERIOD
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.soft import SoftTissue
from sim.true_loop import true_loop_motion
from sim.truth_log import TruthLog
from sim.wrist.wrench_errors import WRENCH_CLASSES, WrenchSensorConfig

REPEATED_LENGTH, REPEATED_SPEED = 0.1, 0.025
"""Of the part of the loop that is scanned twice, from rest to rest [m], [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Study:
    """All that was measured."""

    responses: list[Response]
    swings: dict[str, Swing]
    """By integrator and time step."""
    arms: dict[str, Accuracy]
    """Of arms whose calibration is not read, and of arms that tell it."""
    sensors: list[Readings]
    repeated: int
    """Numbers in the logs of two runs, all of them equal to the last bit."""


def run(out: Path, *, seed: int) -> Study:
    """Measure everything; leave figures, `study.md` and `study.json` in `out`.

    Args:
        out: Where the results go.
        seed: Of the arms and of the sensors.
    """
    scene = Scene(SceneConfig(wrist=WrenchSensorConfig(seed=seed)))
    tissue = SoftTissue.build(scene.phantom)
    motion = true_loop_motion(scene, tissue)
    with writing.staged(out) as folder:
        study = Study(
            responses=servo_response.sweep(),
            swings={
                "RK4, 2 ms": free_swing.swing("RK4", PERIOD),
                "Euler, 2 ms (the twin's)": free_swing.swing("Euler", PERIOD),
                "Euler, 0.5 ms": free_swing.swing("Euler", PERIOD / 4),
            },
            arms={
                "not read": arm_accuracy.along(motion.q[::50], scene.X_FP, "uncalibrated", seed),
                "read": arm_accuracy.along(motion.q[::50], scene.X_FP, "calibrated", seed),
            },
            sensors=[
                wrist_readings.read(WrenchSensorConfig(quality=quality, seed=seed))
                for quality in WRENCH_CLASSES
            ],
            repeated=_repeated(scene, motion),
        )
        figures = twin_figures.write(
            folder, study.responses, study.swings, study.arms, study.sensors
        )
        writing.write_json(folder / "study.json", {"seed": seed, **_summary(study), **provenance()})
        (folder / "study.md").write_text("\n".join(_page(study, figures)) + "\n", encoding="utf-8")
    return study


def _repeated(scene: Scene, motion: Motion) -> int:
    """Scan the same part of the loop twice and compare every number.

    Raises:
        AssertionError: Two of them differ.
    """
    part = section(motion, scene.X_FP, start=0.0, length=REPEATED_LENGTH, speed=REPEATED_SPEED)
    logs = [_scanned(scene, part) for _ in range(2)]
    for (truth, wrench), (other_truth, other_wrench) in [logs]:
        assert np.array_equal(wrench, other_wrench), "two runs must read the same wrenches"
        for name, values in vars(truth).items():
            assert np.array_equal(values, getattr(other_truth, name)), (
                f"two runs must agree in {name}"
            )
    truth, wrench = logs[0]
    return int(wrench.size + sum(values.size for values in vars(truth).values()))


def _scanned(scene: Scene, motion: Motion) -> tuple[TruthLog, np.ndarray]:
    robot = SimRobot(scene, SoftTissue.build(scene.phantom))
    log = execute(robot, motion, ContactConfig(), SafetyLimits())
    return robot.truth_log(), np.stack([sample.wrench_P for sample in log])


def _summary(study: Study) -> dict[str, object]:
    return {
        "servo": [
            {
                "lookahead_s": r.config.lookahead_time,
                "gain": r.config.gain,
                "ramp_lag_ms": (r.ramp_lag * 1e3).tolist(),
                "step_half_time_ms": (r.half_time * 1e3).tolist(),
                "overshoot_pct": 100 * r.overshoot,
            }
            for r in study.responses
        ],
        "energy_drift": {name: swing.largest for name, swing in study.swings.items()},
        "arms": {
            name: {
                "tip_mean_mm": float(arms.position.mean() * 1e3),
                "tip_p95_mm": float(np.quantile(arms.position, 0.95) * 1e3),
                "tilt_mean_deg": float(np.degrees(arms.tilt.mean())),
            }
            for name, arms in study.arms.items()
        },
        "wrist": {
            s.quality: {
                "noise_rms_n": s.noise_rms,
                "drift_n": s.drifted,
                "tilted_max_n": float(s.tilted.max()),
                "contact_error_n": s.contact_error,
                "shaken_rms_n": float(np.sqrt((s.shaken**2).mean())),
                "inertia_max_n": float(s.inertia.max()),
            }
            for s in study.sensors
        },
        "repeated_numbers": study.repeated,
    }


def _page(study: Study, figures: list[str]) -> Iterator[str]:
    yield "# The twin: arm and wrist sensor"
    for name in figures:
        yield f"\n![{name}]({name}.png)"
    yield (
        "\n## servoj: lag on a ramp, time to half of a step, overshoot (joints 1 to 6, least to "
        "most)\n"
    )
    yield (
        "| lookahead [s] | gain | lag [ms] | law's lag [ms] | half of a step [ms] | overshoot [%] |"
    )
    yield "|---|---|---|---|---|---|"
    for r in study.responses:
        lag, half = np.sort(r.ramp_lag * 1e3), np.sort(r.half_time * 1e3)
        yield (
            f"| {r.config.lookahead_time:g} | {r.config.gain:g} | {lag[0]:.1f} .. {lag[-1]:.1f} | "
            f"{r.config.nominal_lag * 1e3:.0f} | {half[0]:.1f} .. {half[-1]:.1f} | "
            f"{100 * r.overshoot:.1f} |"
        )
    yield f"\n## Energy of the free arm over {free_swing.DURATION:.0f} s\n"
    yield "| integrator, step | largest drift over the largest kinetic energy |"
    yield "|---|---|"
    yield from (f"| {name} | {swing.largest:.1e} |" for name, swing in study.swings.items())
    yield f"\n## {arm_accuracy.ARMS} arms around the loop: true against planned tip\n"
    yield "| calibration | mean [mm] | 95 % [mm] | tilt, mean [°] |"
    yield "|---|---|---|---|"
    for name, arms in study.arms.items():
        mean, p95 = arms.position.mean() * 1e3, np.quantile(arms.position, 0.95) * 1e3
        yield f"| {name} | {mean:.2f} | {p95:.2f} | {np.degrees(arms.tilt.mean()):.3f} |"
    yield "\n## Wrist sensors\n"
    yield (
        "| class | noise RMS [N] | drift in 5 min [N] | tilted by 50°, most [N] | error of 5 N [N] "
        "| shaken in air, RMS [N] | of an inertia of [N] |"
    )
    yield "|---|---|---|---|---|---|---|"
    for s in study.sensors:
        yield (
            f"| {s.quality} | {s.noise_rms:.3f} | {s.drifted:.2f} | {s.tilted.max():.2f} | "
            f"{s.contact_error:+.3f} | {np.sqrt((s.shaken**2).mean()):.3f} | {s.inertia.max():.2f} "
            "|"
        )
    yield (
        f"\nTwo runs of a controlled scan agree in all {study.repeated} numbers of their logs, "
        "to the last bit."
    )
