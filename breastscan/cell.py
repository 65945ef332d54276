"""The cell of a robot: what it carries, what looks on, and what stands around, as one file holds
it.

A scan is the same program with another cell. The twin makes its own from its scene; a robot's is a
file, `cell.json`, that a scan leaves in its run folder and that may be edited.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.payload import Payload
from breastscan.robot.ur.rtde_robot import RtdeConfig
from breastscan.robot.ur.worker import LinkLimits
from breastscan.run.writing import write_json
from breastscan.settings import read_fields
from breastscan.vision.camera import SHORTEST_BASELINE, StereoRig

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}
"""How many lengths tell the size of each kind of hull."""
NOT_RIGID = 1e-6
"""Maximum by which a pose's rotation may miss one, entry by entry: rounded files."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A simple hull that the arm must keep clear of, or that it carries."""

    name: str
    kind: Literal["sphere", "capsule", "cylinder", "box"]
    size: tuple[float, ...]
    """Of a sphere its radius, of capsule and cylinder radius and half length along z, of a box its
    half lengths [m]."""
    X: Float[np.ndarray, "4 4"]
    """Where it lies: in F if the arm carries it, else in B [m]."""

    def __post_init__(self) -> None:
        numbers = SIZES[self.kind]
        if len(self.size) != numbers or min(self.size) <= 0:
            why = f"the size of {self.name}, a {self.kind}, must be {numbers} positive lengths"
            raise ConfigError(f"{why} [m], got {self.size}", self.size)
        _require_rigid(self.X, f"the pose of {self.name}")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Everything about a robot's place that a scan goes by."""

    X_FP: Float[np.ndarray, "4 4"]
    """Probe tip in the flange [m]."""
    payload: Payload
    """What hangs on the wrist sensor."""
    rig: StereoRig
    """The cameras' calibration, hand-eye included."""
    tool: tuple[Shape, ...] = ()
    """Hulls that the flange carries."""
    room: tuple[Shape, ...] = ()
    """Hulls of what stands around: table, camera stand."""
    chest: Shape | None = None
    """What lies under the breast, where that is known; a scan finds it with its cameras."""
    kinematics: KinematicCalibration = field(default_factory=KinematicCalibration.nominal)
    """The arm's own kinematics as its maker measured them; the nominal ones may be off by
    millimetres."""
    link: LinkLimits = field(default_factory=LinkLimits)
    """How late robot and program may be for each other."""

    def __post_init__(self) -> None:
        if not self.payload.mass > 0:
            raise ConfigError(
                f"the payload's mass must be positive, got {self.payload.mass} kg", self.payload
            )
        names = [
            shape.name for shape in (*self.tool, *self.room, *([self.chest] if self.chest else []))
        ]
        if len(set(names)) < len(names) or any("/" in name for name in names):
            raise ConfigError(
                f"hulls need names of their own, without '/', got {', '.join(names)}", names
            )
        _require_rigid(self.X_FP, "X_FP")
        _require_rigid(self.rig.X_RL, "X_RL of the rig")
        if self.rig.baseline < SHORTEST_BASELINE:
            raise CalibrationError("the rig's baseline is below 1 mm", self.rig.baseline)
        if self.rig.X_BL is None:
            raise CalibrationError(
                "the rig has no X_BL, so the points have no place in the robot's frame: run "
                "`breastscan handeye` first"
            )
        _require_rigid(self.rig.X_BL, "X_BL of the rig")

    def rtde(self, host: str) -> RtdeConfig:
        """The link to this cell's robot.

        Args:
            host: Name or address of its controller.
        """
        return RtdeConfig(
            host=host,
            X_FP=self.X_FP,
            payload=self.payload,
            limits=self.link,
            kinematics=self.kinematics,
        )

    def save(self, path: Path) -> None:
        """Write the file that `load` reads."""
        write_json(path, self)

    @staticmethod
    def load(path: Path, rig: StereoRig | None = None) -> "Cell":
        """Read a cell's file; `rig` takes the place of the one in it.

        Raises:
            ConfigError: The file is missing, no JSON, lacks an entry, or one is of another kind.
            CalibrationError: The rig has no place in the robot's base, or the kinematics are of
                another arm.
        """
        if not path.is_file():
            raise ConfigError(f"no cell at {path}: expected cell.json, as a scan leaves it", path)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ConfigError(f"{path} is not a JSON file ({error})", path) from error
        values = read_fields(Cell, content, str(path))
        return Cell(**values if rig is None else {**values, "rig": rig})


def _require_rigid(X: np.ndarray, what: str) -> None:
    R = X[:3, :3]
    rigid = np.abs(R @ R.T - np.eye(3)).max() < NOT_RIGID and np.linalg.det(R) > 0
    if not (rigid and np.array_equal(X[3], [0.0, 0.0, 0.0, 1.0])):
        raise ConfigError(f"{what} is not a rigid pose: {X.tolist()}", X)
