"""The cell of a robot: what it carries, what looks on, and what stands around, as one file holds
it.

A scan is the same program with another cell. The twin makes its own from its scene; a robot's is a
file, `cell.json`, that a scan leaves in its run folder and that may be edited.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError, ConfigError
from breastscan.geometry.arm_hulls import link_hulls
from breastscan.geometry.hulls import Shape, require_rigid
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.clearance import Clearance
from breastscan.robot.payload import Payload
from breastscan.robot.ur.rtde_robot import RtdeConfig
from breastscan.robot.ur.worker import LinkLimits
from breastscan.run.writing import write_json
from breastscan.settings import read_fields
from breastscan.vision.camera import SHORTEST_BASELINE, StereoRig


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
        chest = [self.chest] if self.chest else []
        links = [hull for number in range(1, 7) for hull in link_hulls(number)]
        names = [shape.name for shape in (*links, *self.tool, *self.room, *chest)]
        if len(set(names)) < len(names) or any("/" in name for name in names):
            raise ConfigError(
                f"hulls need names of their own, without '/', got {', '.join(names)}", names
            )
        require_rigid(self.X_FP, "X_FP")
        require_rigid(self.rig.X_RL, "X_RL of the rig")
        if self.rig.baseline < SHORTEST_BASELINE:
            raise CalibrationError("the rig's baseline is below 1 mm", self.rig.baseline)
        if self.rig.X_BL is None:
            raise CalibrationError(
                "the rig has no X_BL, so the points have no place in the robot's frame: run "
                "`breastscan handeye` first"
            )
        require_rigid(self.rig.X_BL, "X_BL of the rig")

    @property
    def clearance(self) -> Clearance:
        """What measures how far the arm stays from itself and from the room; the chest is left out,
        which a scan finds.
        """
        return Clearance(self.tool, self.room, self.kinematics)

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
