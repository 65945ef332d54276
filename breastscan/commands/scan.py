"""`breastscan scan`: the phantom with the twin, every error measured, or the same scan with a robot
on the network.

Of a robot, whatever can be refused is refused before anything moves. In contact, the user has said
yes in so many words.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from breastscan.camera.choice import open_camera
from breastscan.camera.folder import FolderCamera
from breastscan.camera.interface import StereoCamera
from breastscan.cell import Cell
from breastscan.commands import resumption
from breastscan.commands.console import Out, Seed, console, progress_bars
from breastscan.commands.results import leave, summarise, tell_plan
from breastscan.commands.settings import require_used
from breastscan.errors import ConfigError, SafetyError
from breastscan.geometry import calibration_file
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.ur import preflight
from breastscan.robot.ur.priority import priority
from breastscan.robot.ur.worker import LinkLimits
from breastscan.run.reading import OPTIONAL_FILES
from breastscan.run.unfinished import ABORTED, CELL_FILE, TRUTH_FILE, settings_file
from breastscan.run.writing import require_writable, staged
from breastscan.scan import CutOff, ScanConfig, Stages
from breastscan.scan import scan as run_scan
from breastscan.vision.camera import StereoRig
from sim.cameras import filament
from sim.cameras.camera import SimStereoCamera
from sim.cameras.video import VideoConfig, render_video
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig
from sim.truth_log import TruthLog
from sim.twin import Twin

TWIN = "twin"
"""Option that names the scene's own cameras."""
SCHEME = "rtde://"
"""Before the host in the option that names a robot."""
CONSENT = "contact"
"""What the user types before the probe touches anything."""


OUT = Path("out/scan")


def scan(
    out: Out = OUT,
    resume: Path | None = None,
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
        resume: Folder of a scan that was cut off with the arm on its way, which goes on where it
            ended, with its own pictures and settings: no other is taken but --yes.
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
    require_used(
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
            "--resume goes on in the folder that it names: leave out --out": resume is not None
            and out not in (OUT, resume),
        }
    )
    out = resume or out
    settings: dict[str, Any] = {"seed": seed, "rig": rig, "scene": scene}
    if robot is None:
        settings |= {"video": video, "fine": fine}
        cut_off = _begun(resume, settings, config)
        _scan_twin(out, settings, rig, config, drawn, cut_off, video=video, fine=fine)
        return
    host = host_of(robot)
    world = Scene(drawn)
    if resume is None:
        whole = robot_cell(world, cell, rig, calibration, link)
    else:
        whole = Cell.load(settings_file(resume).with_name(CELL_FILE))
    settings |= {
        "robot": robot,
        "cell": cell,
        "camera": camera,
        "calibration": calibration,
        "dry_run": dry_run,
        "yes": yes,
        "link": whole.link,
    }
    cut_off = _begun(resume, settings, config)

    def open_stereo() -> StereoCamera:
        if cut_off is not None:
            return FolderCamera(out / ABORTED)
        return SimStereoCamera(world) if camera == TWIN else open_camera(camera)

    _scan_robot(
        out, settings, host, whole, open_stereo, config, cut_off, in_air=dry_run, agreed=yes
    )


def _begun(resume: Path | None, settings: dict, config: ScanConfig) -> CutOff | None:
    """What is gone on with, if anything is."""
    whole = {**settings, **vars(config)}
    return None if resume is None else resumption.cut_off(resume, whole)


def _scan_twin(
    out: Path,
    settings: dict,
    rig: Path | None,
    config: ScanConfig,
    scene: SceneConfig,
    cut_off: CutOff | None,
    *,
    video: bool,
    fine: bool,
) -> None:
    """Scan, measure, film, and leave a complete run folder in `out`."""
    estimated = None if rig is None else StereoRig.load(rig)
    whole = {**settings, **vars(config)}
    require_writable(whole)
    with staged(out, OPTIONAL_FILES) as folder, progress_bars() as listener:
        stages = Stages(listener)
        with Twin(scene, seed=settings["seed"], rig=estimated, stages=stages) as twin:

            def keep_truth(place: Path) -> None:
                twin.robot.truth_log().keep(place / TRUTH_FILE)

            known = _recall_truth(twin, out / ABORTED / TRUTH_FILE, cut_off)
            with stages.stage("cameras"):
                camera = twin.camera if cut_off is None else FolderCamera(out / ABORTED)
            result = run_scan(
                twin.robot, camera, twin.cell, config, stages=stages,
                on_plan=tell_plan, cut_off=cut_off,
                keep=resumption.keep(out, twin.cell, whole, keep_truth, explain=twin.explain),
            )  # fmt: skip
            with stages.stage("truth"):
                result = twin.measured(result) if known else result

        def film() -> None:
            if video and known:
                with stages.stage("video") as report_fraction:
                    look = VideoConfig(fine=fine and _fine_or_reason())
                    render_video(
                        twin.scene, twin.tissue, result.trajectory, folder / "scan.mp4", look,
                        progress=lambda fraction, _: report_fraction(fraction),
                    )  # fmt: skip

        leave(out, folder, result, stages, settings, film)
    summarise(out, result)


def _recall_truth(twin: Twin, file: Path, cut_off: CutOff | None) -> bool:
    """Let a twin go on after the truth of a scan that was cut off; whether all of it is known."""
    if cut_off is None or not cut_off.log:
        return True
    truth = TruthLog.load(file) if file.is_file() else None
    if truth is not None and truth.time[-1] >= cut_off.log[-1].time:
        twin.robot.go_on(truth)
        return True
    console.print(
        "[yellow]What was true of the scan so far was lost when its program was killed, or is less "
        "than this version keeps: nothing is measured against the truth, and there is no video.[/]",
        soft_wrap=True,
    )
    return False


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
    cut_off: CutOff | None,
    *,
    in_air: bool,
    agreed: bool,
) -> None:
    """Check, scan, and leave a run folder in `out`, without what only a simulation knows."""
    if not (in_air or agreed or sys.stdin.isatty()):
        raise SafetyError(
            "nobody is there to agree to the contact: run in a terminal, or give --yes", None
        )
    require_writable({**settings, **vars(config)})
    controller = preflight.examine(host)
    source = settings["calibration"] or settings["cell"] or "the scene"
    console.print(_introduction(controller, cell, source), soft_wrap=True)
    if not (in_air or agreed):
        _ask()
    settings = {**settings, "robot_found": controller}
    kept = resumption.keep(out, cell, {**settings, **vars(config)})

    @contextmanager
    def keep(*known: Any) -> Iterator[None]:
        with kept(*known), priority():
            yield

    with staged(out, OPTIONAL_FILES) as folder, progress_bars() as listener:
        stages = Stages(listener)
        with preflight.opened(cell.rtde(host)) as arm:
            result = run_scan(
                arm,
                open_stereo(),
                cell,
                config,
                stages=stages,
                on_plan=tell_plan,
                keep=keep,
                cut_off=cut_off,
                in_air=in_air,
            )

        leave(out, folder, result, stages, settings)
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
    question = f"The probe will touch what the cameras see. Type {CONSENT!r} to go on: "
    try:
        typed = console.input(question)
    except EOFError:
        typed = ""
    if typed.strip() != CONSENT:
        raise SafetyError(
            f"nothing was touched: {CONSENT!r} was expected, {typed!r} was typed", typed
        )
