"""One whole scan of the simulated phantom, measured against the truth: what does each stage get wrong?"""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import polars as pl
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from breastscan import metrics, record, report
from breastscan.execution import MotionLog, ScanMotion
from breastscan.geometry import se3
from breastscan.scan import ScanConfig, ScanPlan, ScanResult, Stages, scan
from breastscan.vision.camera import StereoRig
from experiments import error_analysis
from experiments.rig_errors import rig_errors
from sim import filament
from sim.camera import SimStereoCamera
from sim.clearance import Clearance
from sim.contact import Mechanics
from sim.mechanics import build_mechanics
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.truth import Truth
from sim.video import Footage, VideoConfig, render_video


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What a scan did, and how far from the truth."""

    result: ScanResult
    trajectory: pl.DataFrame
    metrics: dict[str, Any]


@runtime_checkable
class Onlooker(Protocol):
    """Whoever watches a scan of the twin as it happens."""

    def follow(self, robot: SimRobot) -> None:
        """Meet the arm before anything happens."""
        ...

    def planned(self, plan: ScanPlan) -> None:
        """See the plan before the arm moves."""
        ...


def run(
    out: Path,
    *,
    seed: int,
    video: bool,
    config: ScanConfig,
    scene_config: SceneConfig,
    console: Console,
    rig: Path | None = None,
    fine: bool = False,
) -> dict[str, Any]:
    """Scan, measure, and leave a complete run folder in `out`.

    Args:
        out: Where the results go; earlier ones stay until these are complete.
        seed: Of the phantom's shape and of every noise.
        video: Whether to render `scan.mp4`.
        config: The pipeline.
        scene_config: The world; its seeds are replaced.
        console: Where progress and summary are shown.
        rig: File of an estimated rig that the scan sees with, instead of the true one. The twin's cameras stay the
            scene's.
        fine: Whether `sim.filament` draws the video, where it can.

    Returns:
        The metrics, as in `metrics.json`.
    """
    estimated = None if rig is None else StereoRig.load(rig)
    with record.staged(out) as folder, progress_bars(console) as listener:
        stages = Stages(listener)
        scene_config = seeded(scene_config, seed)
        scene, tissue = build_world(scene_config, stages)
        measured = measure(
            scene, tissue, config, stages, estimated,
            aborted=lambda table, error: keep_aborted(out, table, error, console),
        )  # fmt: skip
        write(folder, measured, {"seed": seed, "video": video, "rig": rig, "scan": config, "scene": scene_config})
        if video:
            with stages.stage("video") as report_share:
                footage = _footage(measured.trajectory)
                film = VideoConfig(fine=fine and _fine_or_reason(console))
                render_video(
                    scene, tissue, footage, folder / "scan.mp4", film, progress=lambda share, _: report_share(share)
                )
        write_report(folder, measured, stages)
    summarise(out, measured, console)
    return measured.metrics


def seeded(config: SceneConfig, seed: int) -> SceneConfig:
    """The scene with its phantom, arm, cameras and sensor drawn from one seed."""
    return replace(
        config,
        phantom=replace(config.phantom, seed=seed),
        arm=replace(config.arm, seed=seed),
        camera=replace(config.camera, seed=seed),
        wrist=replace(config.wrist, seed=seed),
    )


def build_world(config: SceneConfig, stages: Stages) -> tuple[Scene, Mechanics]:
    """The scene and its tissue; the first time, the finite elements take a while."""
    with stages.stage("tissue") as report_share:
        scene = Scene(config)
        return scene, build_mechanics(scene.phantom, lambda share, _: report_share(share))


def measure(
    scene: Scene,
    tissue: Mechanics,
    config: ScanConfig,
    stages: Stages,
    estimated: StereoRig | None = None,
    onlooker: Onlooker | None = None,
    aborted: Callable[[pl.DataFrame, BaseException], None] = lambda table, error: None,
) -> Measured:
    """One scan of the twin, and its errors. The scan sees the images, the rig and the cell's shapes.

    With an estimated rig, its errors are part of the surface's: points are compared in the robot's base. Of a scan that
    is cut off while the probe moves, `aborted` is given the trajectory so far and the error.
    """
    rig = estimated or scene.rig
    robot = SimRobot(scene, tissue)
    if onlooker is not None:
        onlooker.follow(robot)

    def keep(motion: ScanMotion, log: MotionLog, error: BaseException) -> None:
        if log.rows:
            aborted(record.trajectory(log, motion, robot.X_FP, robot.calibration), error)

    with stages.stage("cameras"):
        camera = SimStereoCamera(scene, robot)
    with closing(camera):
        on_plan = onlooker.planned if onlooker is not None else lambda plan: None
        result = scan(robot, camera, rig, config, stages, Clearance(scene, with_chest=False), on_plan, keep)
    table = record.trajectory(result.log, result.plan.motion, robot.X_FP, robot.calibration)
    with stages.stage("truth"):
        truth, log = Truth(scene.phantom, tissue), robot.truth_log()
        places = error_analysis.contact_places(table, log, tissue, truth)
        table = error_analysis.with_truth(table, log, places)
        against_truth = _against_truth(result, rig, scene, truth)
        executed = error_analysis.execution_metrics(places, scene.X_BS, truth)
        forces = error_analysis.force_metrics(table, config.contact.force)
    without_truth = metrics.of_execution(table, result.plan.feed, result.wall_s["execution"])
    return Measured(result=result, trajectory=table, metrics=against_truth | without_truth | executed | forces)


def _against_truth(result: ScanResult, rig: StereoRig, scene: Scene, truth: Truth) -> dict[str, Any]:
    assert rig.X_BL is not None, "a scan needs the rig's place in the base"
    X_BS = scene.X_BS_at(result.images.time)
    X_SL = se3.inverse(X_BS) @ rig.X_BL
    surface = error_analysis.surface_metrics(result.reconstruction, rig, X_SL, truth)
    calibration = {} if rig is scene.rig else rig_errors(rig, scene.rig)
    return surface | calibration | error_analysis.path_metrics(result.plan.path, X_BS, truth)


def write(folder: Path, measured: Measured, settings: dict[str, object]) -> None:
    """Everything but metrics, video and page."""
    result = measured.result
    record.write_json(folder / "config.json", {**settings, "versions": record.versions()})
    record.write_image(folder / "left.png", result.images.left)
    record.write_image(folder / "right.png", result.images.right)
    record.write_image(folder / "disparity.png", record.disparity_picture(result.reconstruction.disparity))
    record.write_cloud(folder / "cloud.ply", result.plan.points_B, result.plan.normals_B)
    record.write_path(folder / "path.csv", result.plan.path.points_B, result.plan.path.normals_B)
    measured.trajectory.write_parquet(folder / "trajectory.parquet")


def keep_aborted(out: Path, table: pl.DataFrame, error: BaseException, console: Console) -> None:
    """Save what was measured before a scan was cut off, and say where."""
    folder = record.write_aborted(out, table, error)
    console.print(f"[yellow]What was measured until then: {folder}[/]", soft_wrap=True)


def write_report(folder: Path, measured: Measured, stages: Stages) -> None:
    """Metrics, with the wall time of each stage, and the page."""
    with stages.stage("report"):
        measured.metrics["wall_s"] = {name: round(seconds, 3) for name, seconds in stages.wall_s.items()}
        record.write_json(folder / "metrics.json", measured.metrics)
        report.write(folder)


def summarise(out: Path, measured: Measured, console: Console) -> None:
    """The metrics in short, and where the page lies."""
    console.print(report.summary(measured.metrics))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True)


def _footage(table: pl.DataFrame) -> Footage:
    return Footage(
        time=table["t"].to_numpy(),
        q=table["q"].to_numpy(),
        force=table["true_force"].to_numpy(),
        phase=table["phase"].to_list(),
    )


def _fine_or_reason(console: Console) -> bool:
    """Whether the fine renderer can be used; where not, the user is told why."""
    reason = filament.unusable()
    if reason is not None:
        console.print(f"[yellow]The video is drawn by the classic renderer: {reason}.[/]")
    return reason is None


@contextmanager
def progress_bars(console: Console) -> Iterator[Callable[[str, float], None]]:
    """A listener for `Stages` that shows one line of progress for each stage."""
    progress = Progress(
        TextColumn("{task.description:<14}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), console=console,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def listen(stage: str, share: float) -> None:
        if stage not in tasks:
            tasks[stage] = progress.add_task(stage, total=1.0)
        progress.update(tasks[stage], completed=share)

    with progress:
        yield listen
