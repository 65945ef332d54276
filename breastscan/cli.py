"""The command line: it alone joins the product, the twin and the experiments, and imports each only when asked."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from breastscan.errors import BreastScanError, ConfigError

console = Console()
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells use it."""

Out = Annotated[
    Path, tyro.conf.arg(metavar="DIR", help="Folder for the results; earlier ones stay until these are complete.")
]
Seed = Annotated[int, tyro.conf.arg(metavar="N", help="Seed of everything random.")]


@dataclass(frozen=True)
class Command:
    """A subcommand: one line of help, and a loader that imports what it needs."""

    summary: str
    load: Callable[[], Callable]


@contextmanager
def twin_imports() -> Iterator[None]:
    """Import MuJoCo, which loads its OpenGL back end at once and fails there in its own ways.

    Raises:
        ConfigError: The back end that MUJOCO_GL names cannot be loaded.
    """
    try:
        yield
    except (AttributeError, ImportError, OSError, RuntimeError) as error:
        from breastscan.commands.doctor import GL_PACKAGES

        raise ConfigError(
            f"MuJoCo does not load with MUJOCO_GL={os.environ.get('MUJOCO_GL', '(unset)')} ({error}): set it to egl; "
            f"where that fails as well, on Debian or Ubuntu: apt-get install {GL_PACKAGES}",
            error,
        ) from error


def _scan() -> Callable:
    from breastscan.robot.ur.worker import LinkLimits
    from breastscan.scan import ScanConfig

    with twin_imports():
        from breastscan.commands import scan_twin
        from sim.scene import SceneConfig

    def scan(
        out: Out = Path("out/scan"),
        seed: Seed = 0,
        video: bool = True,
        fine: bool = False,
        rig: Path | None = None,
        robot: str | None = None,
        camera: str = "twin",
        calibration: Path | None = None,
        dry_run: bool = False,
        yes: bool = False,
        link: LinkLimits = LinkLimits(),  # noqa: B008 (frozen)
        plan: ScanConfig = ScanConfig(),  # noqa: B008 (frozen)
        scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    ) -> None:
        """Scan the phantom with the twin, or with a robot: see, plan, touch, measure the errors, report.

        Args:
            out: Folder for the results.
            seed: Seed of the phantom's shape, the cameras' and the sensor's noise.
            video: Whether to render scan.mp4 of the twin.
            fine: Whether to render it with soft light, where Vulkan is found: several times slower without a graphics
                card.
            rig: File of an estimated rig to see with, from `handeye`; the twin's cameras stay those of the scene.
            robot: rtde://HOST drives the UR5e there, or `breastscan twin`; without it, the twin in process scans.
            camera: Eyes of a robot's scan. twin: the scene's cameras, for a `breastscan twin` of the same seed and
                scene. Else folder:DIR, devices:LEFT,RIGHT or genicam:CTI_FILE[,SERIAL_LEFT,SERIAL_RIGHT].
            calibration: The arm's own kinematics: the controller's calibration.conf, or the YAML of ur_calibration.
            dry_run: Whether a robot travels the path in the air, without contact.
            yes: Whether a robot may touch without a question.
            link: How late robot and program may be for each other.
            plan: Every setting of the pipeline.
            scene: Every setting of the simulated world; a robot's mount and cell as well.
        """
        if robot is None:
            _need_robot(camera != "twin" or calibration is not None or dry_run or yes)
            scan_twin.run(
                out, seed=seed, video=video, fine=fine, config=plan, scene_config=scene, console=console, rig=rig
            )
        else:
            from breastscan.commands import scan_cell

            options = scan_cell.CellScan(
                robot=robot, camera=camera, calibration=calibration, rig=rig, dry_run=dry_run, consent=yes, link=link
            )
            scan_cell.run(out, options, seed=seed, config=plan, scene_config=scene, console=console)

    return scan


def _need_robot(asked: bool) -> None:
    if asked:
        raise ConfigError(
            "--camera, --calibration, --dry-run and --yes are a robot's: give --robot rtde://HOST as well"
        )


def _view() -> Callable:
    from breastscan.scan import ScanConfig

    with twin_imports():
        from breastscan.commands import view_twin
        from sim.live.launch import LiveConfig
        from sim.scene import SceneConfig

    def view(
        out: Out = Path("out/view"),
        seed: Seed = 0,
        rig: Path | None = None,
        live: Annotated[LiveConfig, tyro.conf.arg(name="")] = LiveConfig(),  # noqa: B008 (frozen)
        plan: ScanConfig = ScanConfig(),  # noqa: B008 (frozen)
        scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    ) -> None:
        """Scan the phantom with the twin before your eyes, in a window or, with --web, in a browser.

        Args:
            out: Folder for the results, as of `scan`.
            seed: Seed of the phantom's shape, the cameras' and the sensor's noise.
            rig: File of an estimated rig to see with, from `handeye`; the twin's cameras stay those of the scene.
            live: Where it is watched.
            plan: Every setting of the pipeline.
            scene: Every setting of the simulated world.
        """
        view_twin.run(out, seed=seed, config=plan, scene_config=scene, live=live, console=console, rig=rig)

    return view


def _reconstruct() -> Callable:
    from breastscan.commands import reconstruct as module
    from breastscan.scan import ScanConfig

    def reconstruct(
        left: tyro.conf.Positional[Path],
        right: tyro.conf.Positional[Path],
        /,
        rig: Path,
        out: Out = Path("out/reconstruct"),
        settings: Annotated[ScanConfig, tyro.conf.arg(name="")] = ScanConfig(),  # noqa: B008 (frozen)
    ) -> None:
        """Turn a stereo pair on disk into a point cloud of the breast, or of all that is in view where there is none.

        Args:
            left: Left image, grey or colour, 8 or 16 bit, as the camera gave it (distorted).
            right: Right image of the same instant.
            rig: The rig file of the two cameras.
            out: Folder for cloud.ply, depth.tiff and disparity.png.
            settings: Every setting.
        """
        view = module.reconstruct(left, right, rig, out, settings)
        what = "of the breast" if view.breast else "of the whole view, in which there is no breast,"
        console.print(f"{len(view.points_L)} points {what} with normals in {out / 'cloud.ply'}", soft_wrap=True)

    return reconstruct


def _calibrate() -> Callable:
    from breastscan.commands import calibrate as module
    from breastscan.vision.boards.board import Board

    def calibrate(
        shots: tyro.conf.Positional[Path | None] = None,
        /,
        twin: bool = False,
        out: Out = Path("out/calibrate"),
        seed: Seed = 0,
        board: Board = Board(),  # noqa: B008 (frozen)
    ) -> None:
        """Calibrate a pair of cameras from shots of a chessboard.

        Args:
            shots: Folder of NAME_left.png and NAME_right.png, 30 pairs or so.
            twin: Whether to render the shots with the twin's cameras instead, and compare with the truth.
            out: Folder for rig.yaml, both camera_info files, residuals.csv, metrics.json and figures.
            seed: Seed of the twin's shots.
            board: The board.
        """
        _need_one_source(shots, twin)
        if shots is None:
            with twin_imports():
                from breastscan.commands import calibrate_twin
            metrics = calibrate_twin.run(out, seed=seed, board=board, config=calibrate_twin.ShotConfig())
        else:
            metrics = module.calibrate_rig(shots, out, board)
        _print_metrics(metrics)
        console.print(f"Rig: {out / module.RIG_FILE}", soft_wrap=True)

    return calibrate


def _handeye() -> Callable:
    from breastscan.commands import calibrate as module
    from breastscan.vision.boards.board import Board
    from breastscan.vision.camera import StereoRig

    def handeye(
        shots: tyro.conf.Positional[Path | None] = None,
        /,
        *,
        rig: Path,
        twin: bool = False,
        out: Out = Path("out/handeye"),
        seed: Seed = 0,
        board: Board = Board(),  # noqa: B008 (frozen)
    ) -> None:
        """Find where calibrated cameras stand in the robot's base, from shots of a chessboard that the flange holds.

        Args:
            shots: Folder of NAME_left.png, NAME_right.png and poses.csv (name, x_m, y_m, z_m, rx_rad, ry_rad, rz_rad).
            rig: The rig file of the cameras, from `calibrate`.
            twin: Whether to take the shots with the twin instead, and compare with the truth.
            out: Folder for rig.yaml, residuals.csv, metrics.json and figures.
            seed: Seed of the twin's poses and errors.
            board: The board.
        """
        _need_one_source(shots, twin)
        cameras = StereoRig.load(rig)
        if shots is None:
            with twin_imports():
                from breastscan.commands import handeye_twin
            metrics = handeye_twin.run(out, rig=cameras, seed=seed, board=board, config=handeye_twin.PoseConfig())
        else:
            metrics = module.calibrate_hand_eye(shots, out, cameras, board)
        _print_metrics(metrics)
        console.print(f"Rig: {out / module.RIG_FILE}", soft_wrap=True)

    return handeye


def _need_one_source(shots: Path | None, twin: bool) -> None:
    if (shots is None) != twin:
        raise ConfigError("give either a folder of shots or --twin, which takes them in the simulation", shots)


def _print_metrics(metrics: dict[str, object]) -> None:
    for name, value in metrics.items():
        console.print(f"{name:<30} {f'{value:.4f}' if isinstance(value, float) else value}", highlight=False)


def _plan() -> Callable:
    from breastscan.commands import plan as module

    def plan(
        source: tyro.conf.Positional[Path],
        /,
        out: Out = Path("out/plan"),
        urscript: bool = False,
        settings: Annotated[module.PlanConfig, tyro.conf.arg(name="")] = module.PlanConfig(),  # noqa: B008 (frozen)
    ) -> None:
        """Plan a scan of points on disk, as a trajectory that a UR controller runs.

        Args:
            source: A cloud in the robot's base frame (PLY with normals), or a closed path (CSV: x_m y_m z_m nx ny nz).
            out: Folder for path.csv, trajectory.csv and trajectory.json.
            urscript: Whether to write path.script as well, a program for the controller.
            settings: Every setting.
        """
        motion = module.plan(source, out, settings, urscript=urscript)
        console.print(f"{motion.feed.t[-1]:.1f} s along {motion.feed.s[-1] * 1e3:.0f} mm, in {out}")
        if motion.slowed > 1.0:
            console.print(f"The joints' limits make it {motion.slowed:.2f} times as long as the feedrate's.")
        for use in motion.uses:
            place_mm = motion.feed.s[min(use.sample, len(motion.feed.s) - 1)] * 1e3
            console.print(
                f"{use.limit:<13} {use.share:4.0%} of {use.bound:.3g} {use.unit}, by joint {use.joint} at "
                f"{place_mm:.0f} mm",
                highlight=False,
            )

    return plan


def _compare() -> Callable:
    from breastscan.commands import compare as module

    def compare(
        first: tyro.conf.Positional[Path], second: tyro.conf.Positional[Path], /, out: Out = Path("out/compare")
    ) -> None:
        """Say what one scan did otherwise than another, at equal path length over the loop.

        Args:
            first: Folder of a scan.
            second: Folder of another scan of the same place; differences are this one minus the first.
            out: Folder for compare.json and the figures joints.png, tip.png and force.png.
        """
        console.print(module.table(module.compare(first, second, out)))
        console.print(f"Figures and compare.json in {out}", soft_wrap=True)

    return compare


def _study() -> Callable:
    os.environ.setdefault("MUJOCO_GL", "egl")
    from experiments import study_cameras, study_force, study_joints, study_phantom, study_twin, study_weights

    modules = {
        "cameras": study_cameras,
        "force": study_force,
        "joints": study_joints,
        "phantom": study_phantom,
        "twin": study_twin,
        "weights": study_weights,
    }

    def study(name: tyro.conf.Positional[str], /, out: Out | None = None, seed: Seed = 0) -> None:
        """Answer one question about the twin, with figures and tables.

        Args:
            name: Which study. cameras: what the simulated cameras' errors are and cost. force: how well each force law
                holds the probe, an hour. joints: what the six joints do along the loop, with fixed and with free spin.
                phantom: how far its mechanics can be trusted, and what they cost. twin: how the simulated arm and its
                wrist sensor behave. weights: what the weights of a NURBS curve do.
            out: Folder for study.md, study.json and the figures; by default out/study_NAME.
            seed: Seed of everything random.
        """
        if name not in modules:
            raise ConfigError(f"there is no study {name!r}: use one of {', '.join(modules)}", name)
        folder = out or Path(f"out/study_{name}")
        modules[name].run(folder, seed=seed)
        console.print(f"Figures and tables in {folder}")

    return study


def _twin() -> Callable:
    with twin_imports():
        from breastscan.commands import scan_twin
        from sim.controller.config import ControllerConfig
        from sim.controller.serve import serve
        from sim.scene import SceneConfig

    def twin(
        out: Path | None = None,
        seed: Seed = 0,
        controller: ControllerConfig = ControllerConfig(),  # noqa: B008 (frozen)
        scene: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
    ) -> None:
        """Serve the twin as a UR controller until Ctrl-C: RTDE, dashboard and script ports, in real time.

        Args:
            out: Folder for truth.parquet, what really happened.
            seed: Of the phantom's shape and the sensor's noise, as `scan` takes it.
            controller: What to pretend, and where.
            scene: The world.
        """
        serve(
            scan_twin.seeded(scene, seed),
            controller,
            out,
            lambda text: console.print(text, soft_wrap=True, markup=False),
        )

    return twin


def _doctor() -> Callable:
    from breastscan.commands import doctor as module

    def doctor() -> None:
        """Say what works on this machine and how to mend what does not."""
        findings = module.examine()
        table = Table(box=None)
        for heading in ("", "what", "found", "cure"):
            table.add_column(heading, overflow="fold")
        for finding in findings:
            mark = "[green]works[/]" if finding.works else "[red]broken[/]" if finding.needed else "[yellow]absent[/]"
            table.add_row(mark, finding.what, finding.detail, "" if finding.works else finding.cure)
        console.print(table)
        module.require_needed(findings)

    return doctor


COMMANDS = {
    "scan": Command("scan the phantom with the twin and measure every error, or scan with a robot", _scan),
    "view": Command("the same scan live, in a window or a browser", _view),
    "reconstruct": Command("a stereo pair on disk to a point cloud", _reconstruct),
    "calibrate": Command("a pair of cameras, from shots of a chessboard", _calibrate),
    "handeye": Command("the cameras' place in the robot's base, from a board on the flange", _handeye),
    "plan": Command("points on disk to a trajectory and a program for a UR controller", _plan),
    "compare": Command("two scans, at equal path length", _compare),
    "study": Command("one question about the twin, answered by figures and tables", _study),
    "twin": Command("the twin as a UR controller on the network, for any client of one", _twin),
    "doctor": Command("what works on this machine, and how to mend what does not", _doctor),
}


def usage() -> str:
    """The overview that `breastscan --help` prints."""
    lines = [f"  {name:<12} {command.summary}" for name, command in COMMANDS.items()]
    return "\n".join(
        ["usage: breastscan COMMAND [OPTIONS]", "", *lines, "", "breastscan COMMAND --help lists a command's options."]
    )


def main(arguments: list[str] | None = None) -> None:
    """Run one command; errors that a user can act on end in one line and status 1."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] in ("-h", "--help"):
        print(usage())
        sys.exit(0 if arguments else 2)
    name, *rest = arguments
    errors = Console(stderr=True)
    try:
        if name not in COMMANDS:
            raise ConfigError(f"there is no command {name!r}: use one of {', '.join(COMMANDS)}", name)
        tyro.cli(COMMANDS[name].load(), args=rest, prog=f"breastscan {name}")
    except BreastScanError as error:
        errors.print(f"[red]{type(error).__name__}[/]: {error}", highlight=False, soft_wrap=True)
        sys.exit(1)
    except (KeyboardInterrupt, SystemError) as error:
        # a Ctrl-C that falls into a compiled kernel comes out of it as the cause of a SystemError
        if isinstance(error, SystemError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        errors.print("Interrupted: earlier results are untouched.")
        sys.exit(INTERRUPTED)
