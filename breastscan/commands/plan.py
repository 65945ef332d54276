"""A cloud or a path on disk to a trajectory that a UR controller runs: the planning of a scan without a robot."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from trimesh.exchange.ply import load_ply

from breastscan.commands import export
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import calibration_file, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import motion, pattern
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.motion import Motion
from breastscan.planning.pattern import ChestPlate, PatternConfig
from breastscan.planning.pattern import Path as SkinPath
from breastscan.run import writing

PERIOD = 0.002
"""Control period of an e-Series controller [s]."""
PLATE_SHARE = 0.005
"""Share of a cloud's points, the lowest ones, below which the chest plate is taken to lie."""
PATH_COLUMNS = ("x_m", "y_m", "z_m", "nx", "ny", "nz")
"""Of a path's CSV file: points in B and outward normals."""
UNIT_TOLERANCE = 0.01
"""How far the length of a normal may be from 1: rounded files."""


@dataclass(frozen=True, kw_only=True)
class PlanConfig:
    """What lies on the skin, how fast it is walked, and with which arm and tool."""

    tcp: tuple[float, float, float, float, float, float] = (0.0989949, 0.0, 0.1589949, 0.0, 0.7853982, 0.0)
    """Probe tip in the flange as a UR pose, x y z [m] and rotation vector [rad]: z out of the probe's face, x along its
    array. The default is the twin's, 200 mm of tool bent by 45 degrees."""
    calibration: Path | None = None
    """The arm's own kinematics: the controller's calibration.conf, or ur_calibration's YAML. Without it the tip may be
    millimetres off."""
    plate_height: float | None = None
    """Height of the chest plate in B [m], for a cloud; without it, that of the cloud's lowest points."""
    pattern: PatternConfig = field(default_factory=PatternConfig)
    feedrate: FeedrateLimits = field(default_factory=FeedrateLimits)
    joints: JointPathConfig = field(default_factory=JointPathConfig)


def plan(source: Path, out: Path, config: PlanConfig, *, urscript: bool) -> Motion:
    """Write `path.csv`, `trajectory.csv`, `trajectory.json` and on request `path.script` into `out`.

    Args:
        source: A cloud in B (PLY with normals), or a closed path's points and normals in B (CSV).
        out: Where the results go.
        config: Every setting.
        urscript: Whether to write the program.

    Raises:
        ConfigError: The source cannot be read, or `out` cannot be written.
        CalibrationError: The kinematic calibration is not one.
        PlanningError: The path does not close, or the arm cannot follow it.
    """
    path = read_path(source) if source.suffix.lower() == ".csv" else _loop(source, config)
    arm = KinematicCalibration.nominal() if config.calibration is None else calibration_file.load(config.calibration)
    tcp = np.array(config.tcp, float)
    X_FP = se3.from_rotation_vector(tcp[3:], tcp[:3])
    planned = motion.plan(path, X_FP, PERIOD, config.feedrate, config.joints, calibration=arm)
    with writing.staged(out) as folder:
        writing.write_path(folder / "path.csv", path.points_B, path.normals_B)
        export.write(folder, planned, X_FP, arm.forward(planned.joints.q))
        if urscript:
            (folder / "path.script").write_text(export.urscript(planned, X_FP), encoding="utf-8")
    return planned


def read_path(source: Path) -> SkinPath:
    """A closed path's points and normals, as a scan leaves them in `path.csv`.

    Raises:
        ConfigError: The file is missing or lacks a column.
        PlanningError: A number is not finite, or a normal is not of length 1.
    """
    _require_file(source)
    try:
        table = pl.read_csv(source)
    except pl.exceptions.PolarsError as error:
        raise ConfigError(f"{source} is not a CSV file ({error})", source) from error
    missing = [name for name in PATH_COLUMNS if name not in table.columns]
    if missing:
        raise ConfigError(
            f"{source} lacks the columns {', '.join(missing)}: expected {', '.join(PATH_COLUMNS)}", source
        )
    values = table.select(pl.col(PATH_COLUMNS).cast(pl.Float64, strict=False)).to_numpy()
    points_B, normals_B = np.hsplit(values, 2)
    lengths = np.linalg.norm(normals_B, axis=1)
    bad = ~(np.isfinite(values).all(axis=1) & (np.abs(lengths - 1.0) < UNIT_TOLERANCE))
    if bad.any():
        row = int(np.argmax(bad))
        raise PlanningError(
            f"point {row + 1} of {source} is {values[row]}: expected finite numbers and a normal of length 1",
            values[row],
        )
    return SkinPath(points_B=points_B, normals_B=normals_B / lengths[:, None])


def read_cloud(source: Path) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points [m] and unit normals of a PLY file.

    Raises:
        ConfigError: The file is missing, is no PLY, or has no normals.
    """
    _require_file(source)
    try:
        with source.open("rb") as stream:
            content = load_ply(stream)
    except (ValueError, KeyError, IndexError) as error:
        raise ConfigError(
            f"{source} is not a PLY file ({error}): expected a cloud with normals in B", source
        ) from error
    vertices = content["metadata"]["_ply_raw"]["vertex"]["data"]
    names = vertices.dtype.names or ()
    if len(vertices) == 0 or not {"x", "y", "z", "nx", "ny", "nz"} <= set(names):
        raise ConfigError(f"{source} holds no points with normals (x y z nx ny nz), but {', '.join(names)}", source)
    values = np.stack([np.asarray(vertices[name], float) for name in ("x", "y", "z", "nx", "ny", "nz")], axis=1)
    points, normals = np.hsplit(values[np.isfinite(values).all(axis=1)], 2)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _loop(source: Path, config: PlanConfig) -> SkinPath:
    """The half-height loop on a cloud."""
    points_B, normals_B = read_cloud(source)
    lowest = float(np.quantile(points_B[:, 2], PLATE_SHARE))
    height = lowest if config.plate_height is None else config.plate_height
    plate = ChestPlate(normal_B=np.array([0.0, 0.0, 1.0]), offset=height)
    return pattern.half_height_loop(points_B, normals_B, plate, config.pattern)


def _require_file(source: Path) -> None:
    if not source.is_file():
        raise ConfigError(f"no file at {source}: expected a cloud (PLY) or a path (CSV), as a scan leaves them", source)
