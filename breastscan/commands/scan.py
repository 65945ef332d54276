"""`breastscan scan`: the phantom with the twin, every error measured, or the same scan with a robot
on the network.

Of a robot, whatever can be refused is refused before anything moves. In contact, the user has said
yes in so many words.
"""

import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from breastscan.camera.choice import open_camera
from breastscan.camera.interface import StereoCamera
from breastscan.cell import Cell
from breastscan.commands.console import Out, Seed, console, progress_bars
from breastscan.commands.results import keep_aborted, leave, summarise, tell_plan
from breastscan.errors import ConfigError, SafetyError
from breastscan.geometry import calibration_file
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.ur import preflight
from breastscan.robot.ur.rtde_robot import RtdeRobot
from breastscan.robot.ur.worker import LinkLimits
from breastscan.run.writing import require_writable, staged
from breastscan.scan import ScanConfig, ScanPlan, Stages
from breastscan.scan import scan as run_scan
from breastscan.vision.camera import StereoRig
from sim.cameras import filament
from sim.cameras.camera import SimStereoCamera
from sim.cameras.video import VideoConfig, render_video
from sim.room.cell import cell_of
from sim.room.clearance import Clearance
from sim.scene import Scene, SceneConfig
from sim.twin import Twin

TWIN = "twin"
"""Option that names the scene's own cameras."""
SCHEME = "rtde://"
"""Before the host in the option that names a robot."""
CONSENT = "contact"
"""What the user types before the probe touches anything."""


def scan(
    out: Out = Path("out/scan"),
    seed: Seed = 0,
    video: bool = True,
    fine: bool = False,
    rig: Path | None = None,
    robot: str | None = None,
    cell: Path | None = None,
    camera: str = TWIN,
    calibration: Path | None = None,
    dry_run: bool = False,
    yes: bool = False,
    link: LinkLimits = LinkLimits(),  # noqa: B008 (frozen)
    config: Annotated[ScanConfig, tyro.conf.arg(name="")] = ScanConfig(),  # noqa: B008 (frozen)
    scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
) -> None:
    """Scan the phantom with the twin, or with a robot: see, plan, touch, measure the errors,
    report.

    Args:
        out: Folder for the results.
        seed: Seed of the phantom's shape, the cameras' and the sensor's noise.
        video: Whether to render scan.mp4 of the twin.
        fine: Whether to render it with soft light, where Vulkan is found: several times slower
            without a graphics card.
        rig: File of an estimated rig to see with, from `handeye`; the twin's cameras stay those of
            the scene. It takes the place of a cell's.
        robot: rtde://HOST drives the UR5e there, or `breastscan twin`; without it, the twin in
            process scans.
        cell: File of a robot's cell, cell.json as every scan leaves it; without it, a robot's cell
            is the scene's.
        camera: Cameras of a robot's scan. twin: the scene's cameras, for a `breastscan twin` of the
            same seed and scene. Else folder:DIR, devices:LEFT,RIGHT or
            genicam:CTI_FILE[,SERIAL_LEFT,SERIAL_RIGHT].
        calibration: The arm's own kinematics: the controller's calibration.conf, or the YAML of
            ur_calibration. They take the place of a cell's.
        dry_run: Whether a robot travels the path in the air, without contact.
        yes: Whether a robot may touch without a question.
        link: How late robot and program may be for each other; a slack of 1 leaves it to the cell.
        config: Every setting of the pipeline.
        scene: Every setting of the simulated world; a robot's mount and cell as well.

    Raises:
        ConfigError: Options do not go together, or a file or folder cannot be used.
        CalibrationError: The rig has no place in the robot's base, or a file of calibration is
            none.
        SafetyError: Nobody agreed to the contact, or a limit was passed.
        RobotError: The robot is not there, not ready, or stopped.
    """
    drawn = scene.seeded(seed)
    _require_used(
        {
            "--cell, --camera, --calibration, --dry-run, --yes and link are a robot's: give "
            "--robot rtde://HOST as well": robot is None
            and (cell, camera, calibration, dry_run, yes, link)
            != (None, TWIN, None, False, False, LinkLimits()),
            "--fine is a way to render scan.mp4, which this scan does not make: leave out "
            "--no-video and --robot": fine and not (video and robot is None),
            "--seed and scene are the twin's, of which this scan takes nothing: it has --cell and "
            "--camera": (robot is not None and cell is not None and camera != TWIN)
            and (seed, scene) != (0, SceneConfig()),
        }
    )
    settings = {"seed": seed, "rig": rig, "scene": scene}
    if robot is None:
        settings |= {"video": video, "fine": fine}
        _scan_twin(out, settings, rig, config, drawn, video=video, fine=fine)
        return
    host = host_of(robot)
    world = Scene(drawn)
    whole = robot_cell(world, cell, rig, calibration, link)
    settings |= {
        "robot": robot,
        "cell": cell,
        "camera": camera,
        "calibration": calibration,
        "dry_run": dry_run,
        "yes": yes,
        "link": whole.link,
    }

    def open_stereo() -> StereoCamera:
        return SimStereoCamera(world) if camera == TWIN else open_camera(camera)

    _scan_robot(out, settings, host, whole, open_stereo, config, in_air=dry_run, agreed=yes)


def _require_used(refused: dict[str, bool]) -> None:
    """Accept options none of which would be ignored; of each such case, what the user is told."""
    for reason, holds in refused.items():
        if holds:
            raise ConfigError(reason)


def _scan_twin(
    out: Path,
    settings: dict,
    rig: Path | None,
    config: ScanConfig,
    scene: SceneConfig,
    *,
    video: bool,
    fine: bool,
) -> None:
    """Scan, measure, film, and leave a complete run folder in `out`."""
    estimated = None if rig is None else StereoRig.load(rig)
    require_writable({**settings, **vars(config)})
    with staged(out) as folder, progress_bars() as listener:
        stages = Stages(listener)
        with Twin(scene, seed=settings["seed"], rig=estimated, stages=stages) as twin:
            with stages.stage("cameras"):
                camera = twin.camera
            result = run_scan(
                twin.robot, camera, twin.cell, config, clearances=twin.clearances,
                stages=stages, on_plan=tell_plan, keep=keep_aborted(out),
            )  # fmt: skip
            with stages.stage("truth"):
                result = twin.measured(result)

        def film() -> None:
            if video:
                with stages.stage("video") as report_fraction:
                    look = VideoConfig(fine=fine and _fine_or_reason())
                    render_video(
                        twin.scene, twin.tissue, result.trajectory, folder / "scan.mp4", look,
                        progress=lambda fraction, _: report_fraction(fraction),
                    )  # fmt: skip

        leave(out, folder, result, stages, settings, film)
    summarise(out, result)


def _fine_or_reason() -> bool:
    """Whether the fine renderer can be used; where not, the user is told why."""
    reason = filament.unusable()
    if reason is not None:
        console.print(f"[yellow]The video is drawn by the classic renderer: {reason}.[/]")
    return reason is None


def host_of(option: str) -> str:
    """The host in `rtde://HOST`.

    Raises:
        ConfigError: The option is of another form.
    """
    host = option.removeprefix(SCHEME)
    if host == option or not host or "/" in host or ":" in host:
        raise ConfigError(f"there is no robot {option!r}: give {SCHEME}HOST, with no port", option)
    return host


def robot_cell(
    scene: Scene, file: Path | None, rig: Path | None, calibration: Path | None, link: LinkLimits
) -> Cell:
    """The cell of a file, else that of a scene; what else was given takes the place of what it
    holds.
    """
    estimated = None if rig is None else StereoRig.load(rig)
    cell = cell_of(scene) if file is None else Cell.load(file, estimated)
    return replace(
        cell,
        rig=estimated or cell.rig,
        kinematics=cell.kinematics if calibration is None else calibration_file.load(calibration),
        link=cell.link if link == LinkLimits() else link,
    )


def _scan_robot(
    out: Path,
    settings: dict,
    host: str,
    cell: Cell,
    open_stereo: Callable[[], StereoCamera],
    config: ScanConfig,
    *,
    in_air: bool,
    agreed: bool,
) -> None:
    """Check, scan, and leave a run folder in `out`, without what only a simulation knows."""
    patient = replace(config, safety=config.safety.with_slack(cell.link.slack))
    if not (in_air or agreed or sys.stdin.isatty()):
        raise SafetyError(
            "nobody is there to agree to the contact: run in a terminal, or give --yes", None
        )
    require_writable({**settings, **vars(config)})
    clearances = Clearance(cell, with_chest=False)

    def shown(plan: ScanPlan) -> None:
        plan.motion.require_lift(arm.X_FP, arm.calibration)
        tell_plan(plan)

    controller = preflight.examine(host)
    console.print(
        _introduction(controller, cell, settings["calibration"] or settings["cell"] or "the scene"),
        soft_wrap=True,
    )
    if not (in_air or agreed):
        _ask()
    with staged(out) as folder, progress_bars() as listener:
        stages = Stages(listener)
        with closing(RtdeRobot(cell.rtde(host))) as arm:
            preflight.require_full_speed(arm)
            preflight.require_plausible_sensor(arm)
            result = run_scan(
                arm,
                open_stereo(),
                cell,
                patient,
                clearances=clearances,
                stages=stages,
                on_plan=shown,
                keep=keep_aborted(out),
                in_air=in_air,
            )

        result = replace(result, config=config)  # as it was set
        leave(out, folder, result, stages, {**settings, "robot_found": controller})
    summarise(out, result)


def _introduction(controller: preflight.ControllerIdentity, cell: Cell, source: object) -> str:
    software = ".".join(map(str, controller.version))
    arm = f"UR5e {controller.serial}".strip()
    nominal = np.array_equal(cell.kinematics.X_joints, KinematicCalibration.nominal().X_joints)
    told = (
        "nominal kinematics, which may be off by millimetres"
        if nominal
        else f"kinematics from {source}"
    )
    return f"{arm}, software {software}, at {controller.host}; {told}"


def _ask() -> None:
    typed = console.input(f"The probe will touch what the cameras see. Type {CONSENT!r} to go on: ")
    if typed.strip() != CONSENT:
        raise SafetyError(
            f"nothing was touched: {CONSENT!r} was expected, {typed!r} was typed", typed
        )
