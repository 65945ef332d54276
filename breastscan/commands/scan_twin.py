"""One whole scan of the simulated phantom, measured against the truth: what does each stage get wrong?"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import polars as pl
from rich.console import Console

from breastscan.commands import run_folder
from breastscan.commands.run_folder import Measured
from breastscan.execution import MotionLog, ScanMotion
from breastscan.geometry import se3
from breastscan.run import metrics, writing
from breastscan.scan import ScanConfig, ScanPlan, ScanResult, Stages, scan
from breastscan.vision.camera import StereoRig
from sim import error_analysis
from sim.cameras import filament
from sim.cameras.camera import SimStereoCamera
from sim.cameras.video import Footage, VideoConfig, render_video
from sim.rig_errors import rig_errors
from sim.robot import SimRobot
from sim.room.clearance import Clearance
from sim.scene import Scene, SceneConfig
from sim.tissue.contact import Mechanics
from sim.tissue.mechanics import build_mechanics
from sim.truth import Truth


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
        fine: Whether `sim.cameras.filament` draws the video, where it can.

    Returns:
        The metrics, as in `metrics.json`.
    """
    estimated = None if rig is None else StereoRig.load(rig)
    with writing.staged(out) as folder, run_folder.progress_bars(console) as listener:
        stages = Stages(listener)
        scene_config = seeded(scene_config, seed)
        scene, tissue = build_world(scene_config, stages)
        measured = measure(
            scene, tissue, config, stages, estimated,
            aborted=lambda table, error: run_folder.keep_aborted(out, table, error, console),
        )  # fmt: skip
        settings = {"seed": seed, "video": video, "rig": rig, "scan": config, "scene": scene_config}
        run_folder.write(folder, measured, settings)
        if video:
            with stages.stage("video") as report_share:
                footage = _footage(measured.trajectory)
                film = VideoConfig(fine=fine and _fine_or_reason(console))
                render_video(
                    scene, tissue, footage, folder / "scan.mp4", film, progress=lambda share, _: report_share(share)
                )
        run_folder.write_report(folder, measured, stages)
    run_folder.summarise(out, measured, console)
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
            aborted(writing.trajectory(log, motion, robot.X_FP, robot.calibration), error)

    with stages.stage("cameras"):
        camera = SimStereoCamera(scene, robot)
    with closing(camera):
        on_plan = onlooker.planned if onlooker is not None else lambda plan: None
        result = scan(robot, camera, rig, config, stages, Clearance(scene, with_chest=False), on_plan, keep)
    table = writing.trajectory(result.log, result.plan.motion, robot.X_FP, robot.calibration)
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
