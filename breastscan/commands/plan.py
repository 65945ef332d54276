"""`breastscan plan`: a cloud or a path on disk to a trajectory that a UR controller runs,
without a robot.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl
import tyro
from rich.markup import escape

from breastscan.cell import Cell
from breastscan.cloud import skin_fit
from breastscan.cloud.cleaned import breast_of, cleaned
from breastscan.cloud.cloud_breast import breast_over
from breastscan.cloud.filters import grid_sample
from breastscan.cloud.segment import LOWEST
from breastscan.commands.console import Out, console
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import calibration_file, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import Skin
from breastscan.geometry.tool_hulls import tool_hulls
from breastscan.planning import fitting, motion, pattern
from breastscan.planning.clearance import Body, Clearance
from breastscan.planning.fitting import Task
from breastscan.planning.joint_limits import JointPathConfig, limit_uses
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path as SkinPath
from breastscan.planning.pattern import PatternConfig
from breastscan.robot.ur import program
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run import writing
from breastscan.run.clouds import is_path, read_cloud
from breastscan.run.reading import read_path
from breastscan.scan import PlanningConfig
from breastscan.tissue.drag import TissueConfig

COLUMNS = (
    "t_s",
    *(f"q{k}_rad" for k in range(1, 7)),
    *(f"tip_{axis}_m" for axis in "xyz"),
    *(f"tip_r{axis}_rad" for axis in "xyz"),
)
"""Of the trajectory's table: time, joint angles, and the tool's pose in B as Universal Robots write
it."""
BY_RIM = (
    "The cloud ends with the breast: heights count from the plane through its lower rim. Give "
    "plate_height, or a cloud with the chest around, if that is not the chest."
)
TOP_SEEN = 0.07
"""Angle around the top over which skin must be seen [rad]: 4 mm on a breast 55 mm high."""
TOP_AZIMUTHS = 12
"""In which that is looked for."""
BODY_STEP = 3e-3
"""Edge of the cubes of which one point each of the body is kept clear of [m], as a scan samples
it."""
TWIN_TCP = (0.0989949, 0.0, 0.1589949, 0.0, 0.7853982, 0.0)
"""Probe tip in the flange as a UR pose, x y z [m] and rotation vector [rad]: the twin's, 200 mm of
tool bent by 45 degrees."""


OF_A_CLOUD = ("body_margin", "pressed_depth", "yielding")
"""Settings of the joint path that say how the body is kept clear of, which only a cloud shows."""


def plan(
    source: tyro.conf.Positional[Path],
    /,
    out: Out = Path("out/plan"),
    urscript: bool = False,
    tcp: tuple[float, float, float, float, float, float] = TWIN_TCP,
    calibration: Path | None = None,
    cell: Path | None = None,
    plate_height: float | None = None,
    planning: PlanningConfig = PlanningConfig(),  # noqa: B008 (frozen)
) -> Motion:
    """Plan a scan of points on disk, as a trajectory that a UR controller runs.

    Args:
        source: A cloud or a mesh of the skin in the robot's base frame (PLY, PCD, XYZ, TXT, PTS,
            CSV, OBJ, STL, GLB), or a closed path (CSV: x_m y_m z_m nx ny nz).
        out: Folder for path.csv, trajectory.csv, trajectory.json and config.json.
        urscript: Whether to write path.script as well, a program for the controller.
        tcp: Probe tip in the flange as a UR pose, x y z [m] and rotation vector [rad]: z out of
            the probe's face, x along its array. By default the twin's.
        calibration: The arm's own kinematics: the controller's calibration.conf, or the YAML of
            ur_calibration. Without it the tip may be millimetres off.
        cell: File of the robot's cell, as a scan leaves it: the tool's and the room's hulls, which
            are kept clear of, the probe's place and the arm's kinematics. Without it the arm and a
            hand-held probe on a bar to its tip keep clear of the arm and of the body in the cloud.
        plate_height: Height of a level chest plate in B [m], for a cloud; without it heights count
            from the chest that the cloud shows around the breast.
        planning: Every setting of it.

    Raises:
        ConfigError: The source or the cell cannot be read, settings are given that the source or
            the cell leaves no use for, or `out` cannot be written.
        CalibrationError: The kinematic calibration is not one.
        PerceptionError: A cloud has hardly any points, is in another unit or frame than B's, or has
            no breast, several, or no chest that its heights can count from.
        PlanningError: The path crosses skin that was not seen, or the arm cannot follow it.
    """
    _require_used(source, plate_height, planning)
    X_FP, clearance, arm = _arm(tcp, calibration, cell)
    task = Task(
        X_FP=X_FP,
        period=PERIOD,
        limits=planning.feedrate,
        config=planning.joints,
        clearance=clearance,
        calibration=arm,
    )
    if is_path(source):
        told = ()
        given = _path(source)
        fitted = fitting.fit(lambda rise: given, [0.0], task)
    else:
        cloud = _Cloud.read(source, plate_height)
        told = cloud.told
        task = replace(task, clearance=clearance.of(cloud.body))
        fitted = fitting.fit(lambda rise: cloud.loop(planning.pattern, rise), planning.rises, task)
    path, planned = fitted.path, fitted.motion
    q_retreat = planned.lifted(len(planned.q) - 1, X_FP, arm)
    if not np.isfinite(q_retreat).all():
        raise PlanningError("the arm cannot leave the end of the path: shorten it", q_retreat)
    with writing.staged(out) as folder:
        writing.write_path(folder / "path.csv", path.points_B, path.normals_B)
        _write_tables(folder, planned, q_retreat, X_FP, arm)
        if urscript:
            text = program.urscript(planned.q, planned.qd, planned.q_approach, q_retreat, X_FP)
            (folder / "path.script").write_text(text, encoding="utf-8")
        settings = {
            "tcp": tcp, "calibration": calibration, "cell": cell, "plate_height": plate_height
        }  # fmt: skip
        writing.write_settings(folder, {**settings, "urscript": urscript, "planning": planning})
    _tell(planned, planning.joints, out)
    hidden = motion.hidden_speed(path, planned, fitted.feed, planning.feedrate, PERIOD)
    for line in (*told, fitted.told, hidden):
        if line:
            console.print(f"[yellow]{escape(line)}[/]", soft_wrap=True)
    return planned


def _require_used(source: Path, plate_height: float | None, planning: PlanningConfig) -> None:
    """Refuse settings that lay a path on a cloud, or keep it clear of one, for a given path, those
    of tissue, which no force presses here, and strokes, between which a program would not lift.
    """
    planning.require_used()
    if planning.pattern.kind != "loop":
        raise ConfigError(
            f"a plan is a single path, and --pattern {planning.pattern.kind} has several strokes: "
            "leave it out, or scan",
            planning.pattern.kind,
        )
    if planning.tissue != TissueConfig():
        raise ConfigError(
            "planning.tissue tells how skin moves that is pressed: a plan alone presses none, so "
            "leave it out, or scan",
            planning.tissue,
        )
    joints, usual = planning.joints, JointPathConfig()
    for_cloud = (
        plate_height is not None
        or planning.pattern != PatternConfig()
        or planning.largest_rise != PlanningConfig().largest_rise
        or any(getattr(joints, name) != getattr(usual, name) for name in OF_A_CLOUD)
    )
    if is_path(source) and for_cloud:
        raise ConfigError(
            "plate_height, planning.pattern, planning.largest_rise and planning.joints."
            f"{', '.join(OF_A_CLOUD)} lay a path on a cloud and keep it clear of the body there: "
            f"leave them out for a path that is given ({source})",
            source,
        )


def _arm(
    tcp: tuple[float, ...], calibration: Path | None, cell: Path | None
) -> tuple[np.ndarray, Clearance, KinematicCalibration]:
    """The probe tip in the flange, what measures distances, and the arm's own kinematics."""
    if cell is None:
        arm = KinematicCalibration.nominal()
        if calibration is not None:
            arm = calibration_file.load(calibration)
        X_FP = se3.from_rotation_vector(np.array(tcp[3:], float), np.array(tcp[:3], float))
        return X_FP, Clearance(tool_hulls(X_FP), arm=arm), arm
    if tcp != TWIN_TCP or calibration is not None:
        raise ConfigError(
            f"{cell} says where the probe's tip is and what the arm's kinematics are: leave tcp "
            "and calibration out",
            cell,
        )
    known = Cell.load(cell)
    return known.X_FP, known.clearance, known.kinematics


def _tell(planned: Motion, limits: JointPathConfig, out: Path) -> None:
    duration = PERIOD * (len(planned.q) - 1)
    console.print(f"{duration:.1f} s along {planned.s[-1] * 1e3:.0f} mm, in {out}")
    if planned.slowed > 1.0:
        console.print(
            f"The joints' limits make it {planned.slowed:.2f} times as long as the feedrate's."
        )
    for use in limit_uses(planned.q, PERIOD, limits):
        place_mm = planned.s[min(use.sample, len(planned.s) - 1)] * 1e3
        console.print(
            f"{use.limit:<13} {use.fraction:4.0%} of {use.bound:.3g} {use.unit}, "
            f"by joint {use.joint} at {place_mm:.0f} mm",
            highlight=False,
        )


def _write_tables(
    folder: Path,
    planned: Motion,
    q_retreat: np.ndarray,
    X_FP: np.ndarray,
    arm: KinematicCalibration,
) -> None:
    """`trajectory.csv` and `trajectory.json`, one row a control period."""
    X_BP = arm.forward(planned.q) @ X_FP
    t = PERIOD * np.arange(len(planned.q))
    values = np.hstack([t[:, None], planned.q, se3.pose_vector(X_BP)])
    rows = pl.DataFrame(values, schema=list(COLUMNS))
    writing.write_csv(folder / "trajectory.csv", rows, digits=9)
    content = {
        "tcp": se3.pose_vector(X_FP),
        "q_approach_rad": planned.q_approach,
        "q_retreat_rad": q_retreat,
        "columns": COLUMNS,
        "rows": rows.to_numpy().round(9),
    }
    writing.write_json(folder / "trajectory.json", content)


def _path(source: Path) -> SkinPath:
    points_B, normals_B = read_path(source)
    return SkinPath(points_B=points_B, normals_B=normals_B)


@dataclass(frozen=True)
class _Cloud:
    """Points on the body, the breast's skin through some of them, and what it stands on."""

    body: Body
    chest: Plane
    skin: Skin
    told: tuple[str, ...]
    """What a user must know of how they were found, a sentence each."""

    @staticmethod
    def read(source: Path, plate_height: float | None) -> "_Cloud":
        """A cloud's file, over its own chest or a level plate at this height."""
        cloud = cleaned(read_cloud(source))
        if plate_height is None:
            breast, cloud = breast_of(cloud)
        else:
            plate = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=plate_height)
            breast = breast_over(cloud.points_B, plate)
        points_B = cloud.points_B
        skin = skin_fit.fit_cloud(points_B[breast.skin], cloud.normals_B[breast.skin], breast.chest)
        _require_top_seen(skin, breast.chest)
        above_B = points_B[breast.chest.heights(points_B) > LOWEST]
        body = Body(skin_B=above_B[grid_sample(above_B, BODY_STEP)], chest=breast.chest)
        told = (*cloud.told, BY_RIM) if breast.by_rim else cloud.told
        return _Cloud(body=body, chest=breast.chest, skin=skin, told=told)

    def loop(self, config: PatternConfig, rise: float) -> SkinPath:
        """The half-height loop on it, so much higher [m]."""
        return pattern.half_height_loop(self.skin, self.chest, config, rise)


def _require_top_seen(skin: Skin, chest: Plane) -> None:
    """Refuse a breast whose highest skin that was seen borders on skin that was not: its top, and
    half of its height, are not known.
    """
    top_ab = pattern.top(skin, chest)
    azimuths = np.linspace(0.0, 2 * np.pi, TOP_AZIMUTHS, endpoint=False)
    around = top_ab + TOP_SEEN * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    if not skin.known(around).all():
        place_mm = np.round(1e3 * skin.points(top_ab[None])[0]).astype(int).tolist()
        raise PlanningError(
            f"the highest skin in the cloud, near {place_mm} mm in B, borders on skin that was not "
            "seen, so the breast's height is not known: let the cloud hold the top of the breast",
            place_mm,
        )
