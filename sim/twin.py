"""The twin's cell as one value: robot, cameras and phantom, to scan or to drive by hand, and what a
scan of it got wrong.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.cell import Cell
from breastscan.geometry import se3
from breastscan.run.trajectory import Trajectory
from breastscan.scan import ScanConfig, ScanResult, Stages
from breastscan.vision.camera import StereoRig
from sim import error_analysis
from sim.cameras.camera import SimStereoCamera
from sim.coverage import Touched
from sim.rig_errors import rig_errors
from sim.robot import SimRobot
from sim.room.body_gap import BodyGap
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig
from sim.tissue.mechanics import build_mechanics
from sim.tissue.soft import SoftTissue
from sim.truth import Truth


class Twin:
    """Everything that `breastscan.scan` takes, simulated, and the truth about it.

    A scan gets `robot`, `camera` and `cell`, and knows nothing else of it;
    `robot.servo_joint` and `robot.state` drive the arm period by period. At the end `close` gives
    the graphics memory back, as does leaving a `with` block.
    """

    def __init__(
        self,
        config: SceneConfig = SceneConfig(),  # noqa: B008 (frozen)
        *,
        seed: int = 0,
        rig: StereoRig | None = None,
        stages: Stages | None = None,
    ) -> None:
        """Set the cell up; the first time, the tissue's finite elements take a while.

        Args:
            config: The world.
            seed: Of everything in it that is drawn and has no seed of its own.
            rig: What a scan takes the cameras for, for instance an estimated rig, instead of the
                true one. Its errors are part of the surface's: points are compared in the robot's
                base.
            stages: Takes the wall times and hears of the progress.

        Raises:
            ConfigError: The seed is negative, or the phantom cannot be or cannot be seen.
            CalibrationError: The rig's file cannot be used, or `rig` has no place in the base.
        """
        with (stages or Stages()).stage("tissue") as report_fraction:
            self.scene = Scene(config.seeded(seed))
            self.tissue = build_mechanics(
                self.scene.phantom, lambda fraction, _: report_fraction(fraction)
            )
        self.robot = SimRobot(self.scene, self.tissue)
        cell = cell_of(self.scene)
        self.cell: Cell = cell if rig is None else replace(cell, rig=rig)

    @cached_property
    def camera(self) -> SimStereoCamera:
        """The two cameras, set up when first asked for.

        Raises:
            ConfigError: No OpenGL is usable.
        """
        return SimStereoCamera(self.scene, self.robot)

    @cached_property
    def truth(self) -> Truth:
        """What is known exactly of the phantom."""
        return Truth(self.scene.phantom, self.tissue)

    @property
    def touched_else(self) -> str | None:
        """What else touched so far than the probe's face and the breast, how hard and when, as a
        sentence; None if nothing did (`TruthLog.touched_else`).
        """
        return self.robot.truth_log().touched_else

    def explain(self, error: BaseException) -> None:
        """Note on an error that ended a scan what else touched than the probe's face, if anything
        did: the scan can only guess at that.
        """
        told = self.touched_else
        if told is not None:
            error.add_note(told)

    def measured(self, result: ScanResult) -> ScanResult:
        """A scan of this twin, held against the truth: the true contact in its trajectory, every
        error in its metrics.

        The tissue is pressed again where the probe was, and then rests.
        """
        touched = None
        if result.plan.coverage is not None and isinstance(self.tissue, SoftTissue):
            ends = result.plan.motion.s[list(result.plan.motion.lasts)]
            touched = Touched(self.scene.phantom, self.tissue, ends)
        trajectory, contact = self.contact_metrics(result.trajectory, result.config, touched)
        metrics = self._perception_metrics(result) | result.metrics | contact
        skin_map = None
        if touched is not None and result.plan.coverage is not None:
            X_BS = self.scene.X_BS_at(result.images.time)
            skin_map = touched.skin_map(result.plan.coverage, X_BS)
            metrics |= touched.metrics(result.plan.coverage, X_BS)
            metrics["examination_time_s"] = metrics["scan_time_s"]
        return replace(result, trajectory=trajectory, metrics=metrics, skin_map=skin_map)

    def contact_metrics(
        self, trajectory: Trajectory, config: ScanConfig, touched: Touched | None = None
    ) -> tuple[Trajectory, dict[str, Any]]:
        """An execution by this twin, complete or ended early, held against the truth.

        What is told of the body as a whole, the force on it and the gap to it, is of all that the
        robot did since it was switched on. The tissue is pressed again where the probe was, and
        then rests.

        Args:
            trajectory: What was done; of a scan that failed, `scan_log.trajectory` of its log.
            config: What it was done with.
            touched: Is told every place that was pressed in contact.

        Returns:
            The trajectory with the true contact, and of the metrics (docs/data.md) those that can
            be told: of the part of the loop that was done, if any was.
        """
        log, gap = self.robot.truth_log(), BodyGap(self.scene)

        on_loop = error_analysis.matching_rows(trajectory, log)
        lengths = dict(zip(on_loop.tolist(), trajectory.s.tolist(), strict=True))

        def see(row: int, skin_S: Float[np.ndarray, "v 3"]) -> None:
            gap.add(log.q[row], float(log.rise[row]), skin_S)
            if touched is not None and np.isfinite(lengths.get(row, np.nan)):
                touched.add(lengths[row], log.X_SP[row])

        places, metrics = None, {}
        if trajectory.has_loop:  # else it was in the air
            places = error_analysis.contact_places(trajectory, log, self.tissue, self.truth, see)
            metrics = error_analysis.execution_metrics(
                places, self.scene.X_BS, self.truth, config.planning.pattern.loop_height
            )
        trajectory = error_analysis.with_truth(trajectory, log, places)
        if places is not None:
            metrics |= error_analysis.force_metrics(trajectory, config.contact.force)
            metrics |= error_analysis.breathing_metrics(trajectory, log)
        rest = error_analysis.rows_off_loop(trajectory, log)
        pressing = log.depth[rest] > 0
        for row, skin_S in error_analysis.pressed_again(rest[pressing], log, self.tissue):
            see(row, skin_S)
        for row in rest[~pressing].tolist():
            see(row, self.scene.phantom.skin.vertices_S)
        metrics["force_any_peak_n"] = float(log.force_any.max())
        metrics["clearance_body_min_mm"] = gap.smallest * 1e3
        return trajectory, metrics

    def _perception_metrics(self, result: ScanResult) -> dict[str, Any]:
        """Surface, rig and path of a scan."""
        rig, scene = result.cell.rig, self.scene
        assert rig.X_BL is not None, "a cell's rig has its place in the base"
        X_BS = scene.X_BS_at(result.images.time)
        X_SL = se3.inverse(X_BS) @ rig.X_BL
        surface = error_analysis.surface_metrics(result.reconstruction, rig, X_SL, self.truth)
        calibration = {} if rig is scene.rig else rig_errors(rig, scene.rig)
        paths = [stroke.path for stroke in result.plan.strokes]
        path = error_analysis.path_metrics(paths, X_BS, self.truth)
        return surface | calibration | path

    def close(self) -> None:
        """Give the cameras' graphics memory back."""
        if "camera" in vars(self):
            self.camera.close()

    def __enter__(self) -> "Twin":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
