"""A scan with a robot on the network: the same scan as the twin's, after a preflight, with what needs no truth.

Whatever can be refused is refused before anything moves. In contact, the user has said yes in so many words.
"""

import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from breastscan.camera.interface import StereoCamera
from breastscan.commands import run_folder
from breastscan.commands.run_folder import Measured
from breastscan.errors import CalibrationError, ConfigError, PlanningError, RobotError, SafetyError
from breastscan.execution import MotionLog, ScanMotion, lifted_joints
from breastscan.planning.joint_limits import Clearances
from breastscan.robot.ur import preflight
from breastscan.robot.ur.rtde_robot import FULL_SPEED, RtdeConfig, RtdeRobot
from breastscan.run import metrics, writing
from breastscan.run.columns import Trajectory
from breastscan.scan import ScanConfig, ScanPlan, Stages, scan
from breastscan.vision.camera import StereoRig

SCHEME = "rtde://"
"""Before the host in the option that names a robot."""
CONSENT = "contact"
"""What the user types before the probe touches anything."""
REACH_STEP = 25
"""Rows of the plan from one check of the lifted pose to the next: 1.25 mm at 25 mm/s."""
PLAUSIBLE_FORCE = 3.0
"""Most that a tared sensor may read with nothing touching [N]: the built-in one's precision is 3.5 N in all [UR5e]."""


@dataclass(frozen=True, kw_only=True)
class RobotScan:
    """What a scan with a robot goes by, besides the pipeline's settings."""

    robot: RtdeConfig
    """The controller, and what its arm carries."""
    rig: StereoRig
    """The cameras' calibration, hand-eye included."""
    clearances: Clearances | None = None
    """Measures the arm's distance from itself and the cell; None leaves that out."""
    dry_run: bool = False
    """Whether to travel the path in the air, at its clearance."""
    consent: bool = False
    """Whether the user has agreed to the contact beforehand."""


def host_of(option: str) -> str:
    """The host in `rtde://HOST`.

    Raises:
        ConfigError: The option is of another form.
    """
    host = option.removeprefix(SCHEME)
    if host == option or not host or "/" in host or ":" in host:
        raise ConfigError(f"there is no robot {option!r}: give {SCHEME}HOST, with no port", option)
    return host


def run(
    out: Path,
    setup: RobotScan,
    open_camera: Callable[[], StereoCamera],
    config: ScanConfig,
    settings: dict[str, object],
    console: Console,
) -> dict[str, Any]:
    """Check, scan, and leave a run folder in `out`, without what only a simulation knows.

    Args:
        out: Where the results go; earlier ones stay until these are complete.
        setup: The robot, the rig and the cell.
        open_camera: Opens what takes the pair.
        config: The pipeline.
        settings: What else belongs into `config.json`.
        console: Where progress, questions and summary are shown.

    Returns:
        The metrics, as in `metrics.json`.

    Raises:
        CalibrationError: The rig has no place in the robot's base.
        SafetyError: Nobody agreed to the contact.
        RobotError: The robot is not there, not ready, or stopped.
    """
    config = replace(config, safety=config.safety.with_slack(setup.robot.limits.slack))
    _require_hand_eye(setup.rig)
    if not (setup.dry_run or setup.consent or sys.stdin.isatty()):
        raise SafetyError("nobody is there to agree to the contact: run in a terminal, or give --yes", None)
    controller = preflight.examine(setup.robot.host)
    console.print(_introduction(controller, setup), soft_wrap=True)
    if not (setup.dry_run or setup.consent):
        _ask(console)
    with writing.staged(out) as folder, run_folder.progress_bars(console) as listener:
        stages = Stages(listener)
        with closing(RtdeRobot(setup.robot)) as robot:
            _require_full_speed(robot)
            _require_plausible_sensor(robot)
            measured = _measure(out, robot, open_camera(), setup, config, stages, console)
        run_folder.write(folder, measured, {**settings, "scan": config, "controller": controller})
        run_folder.write_report(folder, measured, stages)
    run_folder.summarise(out, measured, console)
    return measured.metrics


def _measure(
    out: Path,
    robot: RtdeRobot,
    camera: StereoCamera,
    setup: RobotScan,
    config: ScanConfig,
    stages: Stages,
    console: Console,
) -> Measured:
    def keep(motion: ScanMotion, log: MotionLog, error: BaseException) -> None:
        if log.rows:
            table = writing.trajectory(log, motion, robot.X_FP, robot.calibration)
            run_folder.keep_aborted(out, table, error, console)

    def check(plan: ScanPlan) -> None:
        require_reach(plan.motion, robot)

    result = scan(robot, camera, setup.rig, config, stages, setup.clearances, check, keep, in_air=setup.dry_run)
    table = writing.trajectory(result.log, result.plan.motion, robot.X_FP, robot.calibration)
    touched = Trajectory.from_table(table).has_loop
    figures = metrics.of_execution(table, result.plan.feed, result.wall_s["execution"]) if touched else {}
    return Measured(result=result, trajectory=table, metrics=figures)


def _require_hand_eye(rig: StereoRig) -> None:
    if rig.X_BL is None:
        raise CalibrationError(
            "the rig file has no X_BL, so the points have no place in the robot's frame: run `breastscan handeye` first"
        )


def _introduction(controller: preflight.Controller, setup: RobotScan) -> str:
    software = ".".join(map(str, controller.version))
    arm = f"UR5e {controller.serial}".strip()
    file = setup.robot.calibration
    kinematics = f"kinematics from {file}" if file else "nominal kinematics, which may be off by millimetres"
    return f"{arm}, software {software}, at {controller.host}; {kinematics}"


def _require_full_speed(robot: RtdeRobot) -> None:
    if robot.speed_fraction < FULL_SPEED:
        raise RobotError(
            f"the speed slider stands at {robot.speed_fraction:.0%}, expected 100 %, or the arm falls behind its path: "
            "move it up on the pendant",
            robot.speed_fraction,
        )


def _require_plausible_sensor(robot: RtdeRobot) -> None:
    """Tare, in the air, and see that the sensor then reads about nothing."""
    robot.tare()
    force = float(np.linalg.norm(robot.state().wrench_P[:3]))
    if not force < PLAUSIBLE_FORCE:
        raise RobotError(
            f"the force sensor reads {force:.1f} N just after a tare, expected less than {PLAUSIBLE_FORCE:.1f} N: does "
            "something touch the probe, or pull its cable?",
            force,
        )


def require_reach(motion: ScanMotion, robot: RtdeRobot) -> None:
    """Refuse a path that the arm cannot leave along the probe's axis, wherever it is on it.

    Raises:
        PlanningError: It cannot.
    """
    for row in range(0, len(motion.q), REACH_STEP):
        if not np.isfinite(lifted_joints(motion, row, robot.X_FP, robot.calibration)).all():
            raise PlanningError(
                f"{motion.s[row] * 1e3:.0f} mm along the path the probe cannot be lifted by "
                f"{motion.clearance * 1e3:.0f} mm: move the phantom closer to the robot's base",
                row,
            )


def _ask(console: Console) -> None:
    typed = console.input(f"The probe will touch what the cameras see. Type {CONSENT!r} to go on: ")
    if typed.strip() != CONSENT:
        raise SafetyError(f"nothing was touched: {CONSENT!r} was expected, {typed!r} was typed", typed)
