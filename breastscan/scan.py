"""The scan: a stereo pair becomes points, points a path on the skin, the path a motion, the motion
a controlled touch.

Perceive [Zhang, Secs. II, III], plan [Sec. IV], execute [Sec. V]: each step sees only what the one
before it made.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from breastscan import approach, execution, scan_log, skin_view
from breastscan.camera.interface import StereoCamera, StereoPair
from breastscan.cell import Cell
from breastscan.checks import require_positive
from breastscan.cloud import filters, segment
from breastscan.cloud.segment import Breast, SegmentConfig
from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import ConfigError, NoBreastError, PlanningError
from breastscan.geometry import se3
from breastscan.geometry.skin import Skin
from breastscan.planning import examination, fitting, motion, pattern, ways
from breastscan.planning.clearance import Body
from breastscan.planning.coverage import CoverageConfig, Patch
from breastscan.planning.examination import Coverage
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.fitting import Fitted, Task
from breastscan.planning.joint_limits import Corrections, JointPathConfig
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path as SkinPath
from breastscan.planning.pattern import PatternConfig
from breastscan.robot.interface import Robot
from breastscan.run import metrics
from breastscan.run.skin_map import MAP_FILE, SkinMap
from breastscan.run.trajectory import LOG_FILE, Sample, Trajectory
from breastscan.run.writing import (
    write_cloud,
    write_image,
    write_json,
    write_path,
    write_settings,
)
from breastscan.tissue import drag
from breastscan.tissue.drag import PressedBreast, TissueConfig
from breastscan.vision import refine, stereo, triangulation
from breastscan.vision.camera import RectifiedPair, StereoRig
from breastscan.vision.disparity_picture import disparity_picture
from breastscan.vision.matching import pair_check
from breastscan.vision.refine import RefineConfig
from breastscan.vision.refining.photometric import FitConfig
from breastscan.vision.stereo import StereoConfig

USUAL_RISE = 0.006
"""Of a loop that gives way [m]."""
HIGHEST_RISE = 0.05
"""The most that may be asked for [m]."""
RISES = 4
"""Heights that are tried, the one that is asked for among them."""
SAME_PLAN = 1e-6
"""How far two plans of the same pictures may lie apart [rad]."""


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """How a stereo pair becomes points on the skin."""

    stereo: StereoConfig = field(default_factory=lambda: StereoConfig(consistency_px=2, mean_px=1))
    """On the flanks disparity changes by half a pixel from pixel to pixel: a tolerance of 1 px
    would leave holes. A mean would round off the foot, and the refinement does better what it does
    elsewhere."""
    segment: SegmentConfig = field(default_factory=SegmentConfig)
    refine: RefineConfig = field(default_factory=lambda: RefineConfig(fit=FitConfig(smoothing=3.0)))
    """A stiffer field would take off .2 mm of the nipple, and the loop at half height would lie .1
    mm lower."""
    cloud_points: int = 4000
    """Points that down-sampling keeps."""

    def __post_init__(self) -> None:
        require_positive(self, "perception", but=("stereo", "segment", "refine"))


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """How points on the skin become a motion of the arm."""

    pattern: PatternConfig = field(default_factory=PatternConfig)
    coverage: CoverageConfig = field(default_factory=CoverageConfig)
    feedrate: FeedrateLimits = field(default_factory=FeedrateLimits)
    joints: JointPathConfig = field(default_factory=JointPathConfig)
    largest_rise: float = USUAL_RISE
    """How much higher the loop may lie where the arm cannot follow it otherwise [m]."""
    tissue: TissueConfig = field(default_factory=TissueConfig)

    def __post_init__(self) -> None:
        if not 0.0 <= self.largest_rise <= HIGHEST_RISE:
            raise ConfigError(
                f"planning.largest_rise must lie between 0 and {HIGHEST_RISE} m, not "
                f"{self.largest_rise}",
                self.largest_rise,
            )

    def require_used(self) -> None:
        """Refuse settings of another pattern than the scan's.

        Raises:
            ConfigError: One of them was changed.
        """
        usual = PatternConfig(kind=self.pattern.kind)
        if self.pattern.kind == "loop" and self.coverage != CoverageConfig():
            raise ConfigError(
                "planning.coverage lays strokes that cover the breast: give --pattern loops, or "
                "another but loop, or leave it out",
                self.coverage,
            )
        if self.pattern.kind != "loop" and (self.pattern, self.largest_rise) != (usual, USUAL_RISE):
            raise ConfigError(
                "planning.pattern.points, height_fraction and smallest_radius and "
                f"planning.largest_rise are a single loop's: leave them out for {usual.kind}",
                self.pattern,
            )

    @property
    def rises(self) -> list[float]:
        """Heights to try the loop at, over where it is asked for [m]."""
        return np.linspace(0.0, self.largest_rise, RISES).tolist() if self.largest_rise else [0.0]


@dataclass(frozen=True, kw_only=True)
class ScanConfig:
    """Every setting of the pipeline, stage by stage."""

    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    safety: SafetyLimits = field(default_factory=SafetyLimits)

    def __post_init__(self) -> None:
        if not self.contact.force < self.safety.force:
            raise ConfigError(
                f"contact.force ({self.contact.force} N) must be below safety.force "
                f"({self.safety.force} N), or the supervisor ends every scan",
                self.contact.force,
            )

    @property
    def corrections(self) -> Corrections:
        """What the controller may add to a plan, and what the supervisor lets pass."""
        phases = self.contact.phases
        return Corrections(
            pressing_speed=self.contact.rate_limit,
            retreat_speed=phases.escape_speed,
            retreat_acceleration=phases.escape_acceleration,
            stop_time=phases.escape_override_time,
            joint_speed=self.safety.joint_speed,
            joint_acceleration=self.safety.joint_acceleration,
        )

    @property
    def stereo(self) -> StereoConfig:
        """The matcher's settings, as a scan uses them."""
        return self.perception.stereo


@dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """The breast as the cameras saw it."""

    pair: RectifiedPair
    disparity: Float32[np.ndarray, "h w"]
    """Of the whole rectified left view [px], NaN where unknown, refined on the breast."""
    breast: Breast
    """Which pixels are breast, and the plate under it."""
    skin: Skin
    """The smooth skin that both views show, in L."""
    points_L: Float[np.ndarray, "h w 3"]
    """Where each pixel sees the skin [m], NaN where it sees none or the right camera does not."""
    sampled_L: Float[np.ndarray, "n 3"]
    """Some of these points, evenly spread [m]."""
    normals_L: Float[np.ndarray, "n 3"]
    """Unit normals there, outwards."""


@dataclass(frozen=True, kw_only=True)
class ScanPlan:
    """Where the probe is to go."""

    points_B: Float[np.ndarray, "n 3"]
    """The down-sampled cloud [m]."""
    normals_B: Float[np.ndarray, "n 3"]
    """Its outward unit normals."""
    strokes: tuple[Fitted, ...]
    """What is done on the skin, one after the other."""
    motion: Motion
    """All of them."""
    coverage: Coverage | None
    """What they are to cover together; None for a single loop."""
    hidden_speed: str | None
    """What to tell of a top speed that other limits hide; None where some point of the longest
    stroke has it."""

    @property
    def path(self) -> SkinPath:
        """That of the first stroke: of a single loop, the loop."""
        return self.strokes[0].path

    @property
    def points_of_strokes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Points of all strokes in B [m], normals, and of several strokes each point's, from 1."""
        paths = [stroke.path for stroke in self.strokes]
        numbers = [np.full(len(path.points_B), k) for k, path in enumerate(paths, 1)]
        return (
            np.concatenate([path.points_B for path in paths]),
            np.concatenate([path.normals_B for path in paths]),
            np.concatenate(numbers) if len(paths) > 1 else None,
        )

    @property
    def gave_way(self) -> str | None:
        """What to tell of strokes that moved up the skin or of a probe that leans; None where
        neither is.
        """
        told = [stroke.told for stroke in self.strokes if stroke.told]
        if len(self.strokes) > 1 and told:
            return f"Of {len(self.strokes)} strokes {len(told)} gave way. {told[-1]}"
        return told[0] if told else None


@dataclass(frozen=True, kw_only=True)
class ScanResult:
    """Everything that a scan saw, planned and did."""

    config: ScanConfig
    cell: Cell
    images: StereoPair
    reconstruction: Reconstruction
    plan: ScanPlan
    trajectory: Trajectory
    metrics: dict[str, Any]
    """What was measured, named as in docs/data.md; empty where the loop was never reached."""
    wall_s: dict[str, float]
    """Wall time of each stage [s]."""
    skin_map: SkinMap | None = None
    """Which skin was touched; None where that is not known, or a single loop was scanned."""

    def summary(self) -> dict[str, Any]:
        """What `metrics.json` holds: the metrics, and the wall time of each stage [s]."""
        wall_s = {name: round(seconds, 3) for name, seconds in self.wall_s.items()}
        return {**self.metrics, "wall_s": wall_s}

    def save(self, folder: Path, *, seed: int | None = None, **settings: object) -> None:
        """Write what was seen, planned, done and measured into a run folder (docs/data.md).

        Args:
            folder: Made where it is missing.
            seed: Of what was drawn, if anything was.
            settings: What else the scan was made with, for `config.json`.
        """
        folder.mkdir(parents=True, exist_ok=True)
        write_settings(folder, {"seed": seed, **settings, **vars(self.config)})
        write_json(folder / "metrics.json", self.summary())
        self.cell.save(folder / "cell.json")
        write_image(folder / "left.png", self.images.left)
        write_image(folder / "right.png", self.images.right)
        write_image(folder / "disparity.png", disparity_picture(self.reconstruction.disparity))
        write_cloud(folder / "cloud.ply", self.plan.points_B, self.plan.normals_B)
        write_path(folder / "path.csv", *self.plan.points_of_strokes)
        if self.skin_map is not None:
            self.skin_map.save(folder / MAP_FILE)
        self.trajectory.save(folder / LOG_FILE, seed=seed)


@dataclass(frozen=True, kw_only=True)
class CutOff:
    """A scan that was cut off with the arm on its way, to go on with the same pictures, cell and
    settings.
    """

    log: list[Sample]
    """What it did."""
    q: Float[np.ndarray, "n 6"]
    """Joint angles of its plan [rad]."""
    q_home: Float[np.ndarray, "6"]
    """Where the arm stood before it, and parks in the end [rad]."""

    def require_same(self, planned: Motion) -> None:
        """Refuse a plan that has come out another: the log would go on somewhere else.

        Raises:
            PlanningError: It has.
        """
        same = self.q.shape == planned.q.shape
        apart = float(np.abs(self.q - planned.q).max()) if same else math.inf
        if not apart < SAME_PLAN:
            raise PlanningError(
                "the plan has come out another than that of the scan which was cut off "
                f"({apart:.1g} rad apart, expected less than {SAME_PLAN:g}): is this another "
                "version, or another machine? Scan anew",
                apart,
            )


Keep = Callable[[StereoPair, ScanPlan, Robot, list[Sample]], AbstractContextManager[None]]
"""Keeps what a scan does from being lost while the arm is on its way: a context that the execution
runs in, made of what is known before, and of the log as it will grow."""


class Stages:
    """Times the stages by name, and tells a listener which one runs and how far it is."""

    def __init__(
        self, listener: Callable[[str, float], None] = lambda name, fraction: None
    ) -> None:
        self.wall_s: dict[str, float] = {}
        self._listener = listener

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Time the block; it may call what it gets with the fraction done."""
        self._listener(name, 0.0)
        start = time.perf_counter()
        yield lambda fraction: self._listener(name, fraction)
        self.wall_s[name] = self.wall_s.get(name, 0.0) + time.perf_counter() - start
        self._listener(name, 1.0)


def scan(
    robot: Robot,
    camera: StereoCamera,
    cell: Cell,
    config: ScanConfig = ScanConfig(),
    *,
    stages: Stages | None = None,
    on_plan: Callable[[ScanPlan], None] = lambda plan: None,
    keep: Keep = lambda images, plan, robot, log: nullcontext(),
    cut_off: CutOff | None = None,
    in_air: bool = False,
) -> ScanResult:
    """See the breast, plan a loop around it, follow the loop with the probe at constant force.

    Args:
        robot: The twin or the real arm, parked out of the cameras' view; it parks there again.
        camera: What takes the pair.
        cell: Where they stand.
        config: Every setting.
        stages: Takes the wall times and hears of the progress.
        on_plan: Shown the plan before the arm moves.
        keep: Context in which the arm moves.
        cut_off: What is gone on with, where it ended; `camera` then gives its pictures.
        in_air: Whether to travel the path at its clearance, without contact.

    Raises:
        ConfigError: Settings of another pattern than the scan's were changed.
        PerceptionError: No breast was found in the images.
        PlanningError: The path cannot be followed by the arm, or left along the probe's axis.
        SafetyError: A limit was passed in contact; the probe was retreated.
        RobotError: The robot refused, or met no skin.
    """
    config.planning.require_used()
    stages = stages or Stages()
    with stages.stage("capture"):
        images = camera.capture()
    reconstruction = perceive(images, cell.rig, config.perception, stages)
    q_home = robot.state().q if cut_off is None else cut_off.q_home
    log = [] if cut_off is None else cut_off.log
    plan = plan_scan(reconstruction, cell, robot, config, stages, q_home, log)
    on_plan(plan)
    if cut_off is not None:
        cut_off.require_same(plan.motion)
    with keep(images, plan, robot, log), stages.stage("execution") as progress:
        execution.execute(
            robot,
            plan.motion,
            config.contact,
            config.safety.with_slack(cell.link.slack),
            log=log,
            progress=progress,
            start=scan_log.resumption_row(log, plan.motion.s),
            in_air=in_air,
            q_home=q_home,
        )
    trajectory = scan_log.trajectory(log, plan.motion, robot)
    wall = stages.wall_s["execution"]
    fluctuation = max(stroke.feed.fluctuation_pct for stroke in plan.strokes)
    return ScanResult(
        config=config,
        cell=cell,
        images=images,
        reconstruction=reconstruction,
        plan=plan,
        trajectory=trajectory,
        metrics=metrics.of_execution(trajectory, fluctuation, wall) if trajectory.has_loop else {},
        wall_s=stages.wall_s,
    )


def perceive(
    images: StereoPair, rig: StereoRig, config: PerceptionConfig, stages: Stages
) -> Reconstruction:
    """From a raw pair to the breast's skin, points and normals, in the left camera's frame."""
    pair, matched = match(images, rig, config, stages)
    try:
        return reconstruct_breast(pair, matched, config, stages)
    except NoBreastError:
        check_sides(images, matched, rig, config)  # a better reason, perhaps
        raise


def match(
    images: StereoPair, rig: StereoRig, config: PerceptionConfig, stages: Stages
) -> tuple[RectifiedPair, Float32[np.ndarray, "h w"]]:
    """The rectified pair, and the disparity of all that both cameras see in it [px]."""
    with stages.stage("rectification"):
        pair = rig.rectify(images.left, images.right)
        pair_check.check_exposure(images.left, "the left image")
        pair_check.check_exposure(images.right, "the right image")
    with stages.stage("stereo"):
        return pair, stereo.disparity_map(pair.left, pair.right, config.stereo)


def reconstruct_breast(
    pair: RectifiedPair,
    matched: Float32[np.ndarray, "h w"],
    config: PerceptionConfig,
    stages: Stages,
) -> Reconstruction:
    """The breast in a matched pair, refined on the images.

    Raises:
        NoBreastError: There is none.
    """
    with stages.stage("segmentation"):
        breast = segment.segment_breast(triangulation.triangulate(matched, pair), config.segment)
    with stages.stage("refinement"):
        refined, around = (
            refine.refine(pair.left, pair.right, matched, part, config.refine)
            for part in (breast.mask, breast.ring)
        )
        breast = segment.on_refined(breast, triangulation.triangulate(around.disparity, pair))
    with stages.stage("surface"):
        skin, seen = skin_view.see_skin(pair, refined, breast)
        points_L = np.full((*seen.shape, 3), np.nan)
        cloud_L = skin_view.points(seen, pair)
        points_L[np.isfinite(seen)] = cloud_L
        sampled_L = cloud_L[filters.uniform_sample(cloud_L, min(config.cloud_points, len(cloud_L)))]
    return Reconstruction(
        pair=pair,
        disparity=np.where(np.isfinite(seen), seen, refined.disparity).astype(np.float32),
        breast=breast,
        skin=skin,
        points_L=points_L,
        sampled_L=sampled_L,
        normals_L=skin.normals(skin.chart(sampled_L)),
    )


def check_sides(
    images: StereoPair,
    matched: Float32[np.ndarray, "h w"],
    rig: StereoRig,
    config: PerceptionConfig,
) -> None:
    """Refuse a pair that matches better with left and right exchanged.

    Raises:
        PerceptionError: It does.
    """
    if images.left.shape == images.right.shape:
        pair = rig.rectify(images.right, images.left)
        pair_check.check_exchanged(
            matched, stereo.disparity_map(pair.left, pair.right, config.stereo)
        )


def plan_scan(
    reconstruction: Reconstruction,
    cell: Cell,
    robot: Robot,
    config: ScanConfig,
    stages: Stages,
    q_home: Float[np.ndarray, "6"],
    log: list[Sample] | None = None,
) -> ScanPlan:
    """From the cloud to joint angles for every control period, and the ways to and from them.

    Args:
        reconstruction: What the cameras saw.
        cell: Where the robot stands.
        robot: The twin or the real arm.
        config: Every setting.
        stages: Takes the wall times and hears of the progress.
        q_home: Where the arm comes from, and parks in the end [rad].
        log: Of a scan that was cut off and is gone on with.
    """
    X_BL = cell.rig.X_BL
    assert X_BL is not None, "a cell's rig has its place in the base"
    planning = config.planning
    points_B = se3.transform(X_BL, reconstruction.sampled_L)
    skin = reconstruction.skin.seen_from(X_BL)
    plate = reconstruction.breast.plate.seen_from(X_BL)
    task = Task(
        X_FP=robot.X_FP,
        period=robot.period,
        limits=planning.feedrate,
        config=planning.joints,
        clearance=cell.clearance.of(Body(skin_B=points_B, chest=plate)),
        corrections=config.corrections,
        calibration=robot.calibration,
    )
    loop = coverage = None
    with stages.stage("path"):
        if planning.pattern.kind == "loop":
            loop = pattern.half_height_loop(skin, plate, planning.pattern)
        else:
            task = examination.held(task)
            patch = Patch(*drag.patch(config.contact.force, skin, planning.tissue))
            coverage = Coverage.planned(
                skin, plate, planning.pattern.kind, planning.coverage, patch, task
            )
    with stages.stage("drag"):
        tissue = PressedBreast.perceived(points_B, plate, planning.tissue)

    def pressed(path: SkinPath) -> SkinPath:
        """A path along the normals of the places to press for it."""
        places_B = tissue.places(path.points_B, path.normals_B, plate.normal, config.contact.force)
        return pattern.pressed_at(path, skin, places_B)

    def loop_at(rise: float) -> SkinPath:
        """The loop, so much higher [m]."""
        if rise or loop is None:
            return pressed(pattern.half_height_loop(skin, plate, planning.pattern, rise))
        return pressed(loop)

    strokes: list[Fitted] = []
    with stages.stage("motion") as progress:
        if coverage is None:
            strokes = [fitting.fit(loop_at, planning.rises, task)]
        else:
            strokes = coverage.fitted(pressed, task, progress)
        longest = max(strokes, key=lambda stroke: float(stroke.motion.s[-1]))
        hidden = motion.hidden_speed(
            longest.path, longest.motion, longest.feed, planning.feedrate, robot.period
        )
    with stages.stage("drag"):
        planned = [
            replace(
                stroke.motion,
                drag_B=tissue.along_path(
                    robot.calibration.forward(stroke.motion.q) @ robot.X_FP, stroke.motion.s
                ),
                chest_normal_B=plate.normal,
            )
            for stroke in strokes
        ]
    with stages.stage("motion"):
        for stroke in planned:
            stroke.require_lift(robot.X_FP, robot.calibration)
        whole, kept = ways.connected(planned, task, q_home)
        if log and approach.place(robot, whole) is None:
            begun = whole.stroke_of(scan_log.resumption_row(log, whole.s))
            whole = ways.entered(whole, task, begun, robot.state().q)
    return ScanPlan(
        points_B=points_B,
        normals_B=se3.rotate(X_BL, reconstruction.normals_L),
        strokes=tuple(strokes[k] for k in kept),
        motion=whole,
        coverage=coverage,
        hidden_speed=hidden,
    )
