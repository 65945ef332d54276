"""`breastscan plan`: a cloud or a path on disk to a trajectory that a UR controller runs,
without a robot.
"""

from pathlib import Path

import numpy as np
import polars as pl
import tyro

from breastscan.cloud import skin_fit
from breastscan.commands.console import Out, console
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import calibration_file, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.plane import Plane
from breastscan.planning import motion, pattern
from breastscan.planning.joint_limits import JointPathConfig, limit_uses
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import Path as SkinPath
from breastscan.planning.pattern import PatternConfig
from breastscan.robot.ur import program
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.run import writing
from breastscan.run.reading import read_cloud, read_path
from breastscan.scan import PlanningConfig

COLUMNS = (
    "t_s",
    *(f"q{k}_rad" for k in range(1, 7)),
    *(f"tip_{axis}_m" for axis in "xyz"),
    *(f"tip_r{axis}_rad" for axis in "xyz"),
)
"""Of the trajectory's table: time, joint angles, and the tool's pose in B as Universal Robots write
it."""
PLATE_QUANTILE = 0.005
"""Fraction of a cloud's points, the lowest ones, below which the chest plate is taken to lie."""


TWIN_TCP = (0.0989949, 0.0, 0.1589949, 0.0, 0.7853982, 0.0)
"""Probe tip in the flange as a UR pose, x y z [m] and rotation vector [rad]: the twin's, 200 mm of
tool bent by 45 degrees."""


ABOVE_TABLE = PlanningConfig(joints=JointPathConfig())
"""Of points that need not lie on a body: the arm keeps clear of the table alone."""


def plan(
    source: tyro.conf.Positional[Path],
    /,
    out: Out = Path("out/plan"),
    urscript: bool = False,
    tcp: tuple[float, float, float, float, float, float] = TWIN_TCP,
    calibration: Path | None = None,
    plate_height: float | None = None,
    planning: PlanningConfig = ABOVE_TABLE,
) -> Motion:
    """Plan a scan of points on disk, as a trajectory that a UR controller runs.

    Args:
        source: A cloud in the robot's base frame (PLY with normals), or a closed path (CSV: x_m y_m
            z_m nx ny nz).
        out: Folder for path.csv, trajectory.csv, trajectory.json and config.json.
        urscript: Whether to write path.script as well, a program for the controller.
        tcp: Probe tip in the flange as a UR pose, x y z [m] and rotation vector [rad]: z out of
            the probe's face, x along its array. By default the twin's.
        calibration: The arm's own kinematics: the controller's calibration.conf, or the YAML of
            ur_calibration. Without it the tip may be millimetres off.
        plate_height: Height of the chest plate in B [m], for a cloud; without it, that of the
            cloud's lowest points.
        planning: Every setting of it.

    Raises:
        ConfigError: The source cannot be read, is a path where settings are for a cloud, a margin
            is set that nothing measures, or `out` cannot be written.
        CalibrationError: The kinematic calibration is not one.
        PerceptionError: A cloud has hardly any points.
        PlanningError: The path crosses skin that was not seen, or the arm cannot follow it.
    """
    is_path = source.suffix.lower() == ".csv"
    if is_path and (plate_height is not None or planning.pattern != PatternConfig()):
        raise ConfigError(
            "plate_height and planning.pattern lay a path on a cloud: leave them out for a path "
            f"that is given ({source})",
            source,
        )
    path = _path(source) if is_path else _loop(source, plate_height, planning.pattern)
    if planning.joints.collision_margin != JointPathConfig.collision_margin:
        raise ConfigError(
            "planning.joints.collision_margin is a distance that nothing measures here, where no "
            "cell is known: leave it out",
            planning.joints.collision_margin,
        )
    arm = (
        KinematicCalibration.nominal()
        if calibration is None
        else calibration_file.load(calibration)
    )
    X_FP = se3.from_rotation_vector(np.array(tcp[3:], float), np.array(tcp[:3], float))
    planned, feed = motion.plan_motion(
        path, X_FP, PERIOD, planning.feedrate, planning.joints, calibration=arm
    )
    q_retreat = planned.lifted(len(planned.q) - 1, X_FP, arm)
    if not np.isfinite(q_retreat).all():
        raise PlanningError("the arm cannot leave the end of the path: shorten it", q_retreat)
    with writing.staged(out) as folder:
        writing.write_path(folder / "path.csv", path.points_B, path.normals_B)
        _write_tables(folder, planned, q_retreat, X_FP, arm)
        if urscript:
            text = program.urscript(planned.q, planned.qd, planned.q_approach, q_retreat, X_FP)
            (folder / "path.script").write_text(text, encoding="utf-8")
        settings = {"tcp": tcp, "calibration": calibration, "plate_height": plate_height}
        writing.write_settings(folder, {**settings, "urscript": urscript, "planning": planning})
    _tell(planned, planning.joints, out)
    hidden = motion.hidden_speed(path, planned, feed, planning.feedrate, PERIOD)
    if hidden:
        console.print(f"[yellow]{hidden}[/]", soft_wrap=True)
    return planned


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


def _loop(source: Path, plate_height: float | None, config: PatternConfig) -> SkinPath:
    """The half-height loop on a cloud."""
    points_B, normals_B = read_cloud(source)
    lowest = float(np.quantile(points_B[:, 2], PLATE_QUANTILE))
    height = lowest if plate_height is None else plate_height
    plate = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=height)
    skin = skin_fit.fit_cloud(points_B, normals_B, plate)
    return pattern.half_height_loop(skin, plate, config)
