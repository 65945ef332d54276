"""One whole scan of the simulated phantom, measured against the truth: what does each stage get
wrong?
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from typing import Any

from breastscan.geometry import se3
from breastscan.run import metrics
from breastscan.scan import Keep, ScanConfig, ScanPlan, ScanResult, Stages, scan
from breastscan.vision.camera import StereoRig
from sim import error_analysis
from sim.cameras.camera import SimStereoCamera
from sim.rig_errors import rig_errors
from sim.robot import SimRobot
from sim.room.cell import cell_of
from sim.room.clearance import Clearance
from sim.scene import Scene, SceneConfig
from sim.tissue.contact import Mechanics
from sim.tissue.mechanics import build_mechanics
from sim.truth import Truth


def build_world(config: SceneConfig, stages: Stages) -> tuple[Scene, Mechanics]:
    """The scene and its tissue; the first time, the finite elements take a while."""
    with stages.stage("tissue") as report_fraction:
        scene = Scene(config)
        return scene, build_mechanics(scene.phantom, lambda fraction, _: report_fraction(fraction))


def measured_scan(
    scene: Scene,
    tissue: Mechanics,
    config: ScanConfig,
    stages: Stages,
    estimated: StereoRig | None = None,
    follow: Callable[[SimRobot], None] = lambda robot: None,
    on_plan: Callable[[ScanPlan], None] = lambda plan: None,
    keep: Keep = lambda trajectory, error: None,
) -> tuple[ScanResult, dict[str, Any]]:
    """One scan of the twin, and its metrics. The scan sees the images, the rig and the cell's
    shapes.

    Args:
        scene: Where it happens.
        tissue: What the probe presses.
        config: The pipeline.
        stages: Takes the wall times and hears of the progress.
        estimated: The rig that the scan sees with, instead of the true one. Its errors are part of
            the surface's: points are compared in the robot's base.
        follow: Shown the arm before anything happens.
        on_plan: Shown the plan before the arm moves.
        keep: Of a scan that is cut off while the probe moves, is given the trajectory so far and
            the error.

    Returns:
        The result, the true contact in its trajectory, and the metrics as in `metrics.json`.
    """
    cell = cell_of(scene)
    if estimated is not None:
        cell = replace(cell, rig=estimated)
    robot = SimRobot(scene, tissue)
    follow(robot)
    with stages.stage("cameras"):
        camera = SimStereoCamera(scene, robot)
    with closing(camera):
        result = scan(
            robot, camera, cell, config, stages, Clearance(cell, with_chest=False), on_plan, keep
        )
    with stages.stage("truth"):
        truth, log = Truth(scene.phantom, tissue), robot.truth_log()
        places = error_analysis.contact_places(result.trajectory, log, tissue, truth)
        trajectory = error_analysis.with_truth(result.trajectory, log, places)
        against_truth = _against_truth(result, cell.rig, scene, truth)
        executed = error_analysis.execution_metrics(places, scene.X_BS, truth)
        forces = error_analysis.force_metrics(trajectory, config.contact.force)
    without_truth = metrics.of_execution(
        trajectory, result.plan.feed.fluctuation_pct, result.wall_s["execution"]
    )
    return replace(result, trajectory=trajectory), against_truth | without_truth | executed | forces


def _against_truth(
    result: ScanResult, rig: StereoRig, scene: Scene, truth: Truth
) -> dict[str, Any]:
    assert rig.X_BL is not None, "a cell's rig has its place in the base"
    X_BS = scene.X_BS_at(result.images.time)
    X_SL = se3.inverse(X_BS) @ rig.X_BL
    surface = error_analysis.surface_metrics(result.reconstruction, rig, X_SL, truth)
    calibration = {} if rig is scene.rig else rig_errors(rig, scene.rig)
    return surface | calibration | error_analysis.path_metrics(result.plan.path, X_BS, truth)
