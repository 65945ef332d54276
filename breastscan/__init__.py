"""See a breast, plan a path on its skin, follow it with a probe at constant force: what programs
start from.

A name is imported when it is first asked for, so that `import breastscan`, and with it `breastscan
--help` and `breastscan doctor`, work where OpenCV or a kernel does not load.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from breastscan.exports import lazily

if TYPE_CHECKING:
    from breastscan.camera.interface import StereoCamera as StereoCamera
    from breastscan.camera.interface import StereoPair as StereoPair
    from breastscan.cell import Cell as Cell
    from breastscan.errors import BreastScanError as BreastScanError
    from breastscan.execution import execute as execute
    from breastscan.robot.interface import Robot as Robot
    from breastscan.robot.interface import RobotState as RobotState
    from breastscan.run.trajectory import Trajectory as Trajectory
    from breastscan.scan import ScanConfig as ScanConfig
    from breastscan.scan import ScanResult as ScanResult
    from breastscan.scan import Stages as Stages
    from breastscan.scan import scan as scan
    from breastscan.vision.camera import StereoRig as StereoRig

HOMES = {
    "BreastScanError": "errors",
    "Cell": "cell",
    "Robot": "robot.interface",
    "RobotState": "robot.interface",
    "ScanConfig": "scan",
    "ScanResult": "scan",
    "Stages": "scan",
    "StereoCamera": "camera.interface",
    "StereoPair": "camera.interface",
    "StereoRig": "vision.camera",
    "Trajectory": "run.trajectory",
    "execute": "execution",
    "scan": "scan",
}
"""In which module of this package each name lives."""

__getattr__, __dir__ = lazily(__name__, HOMES)


class _Package(ModuleType):
    """Keeps `scan` the function: who imports the module of that name would put it in its place."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name == "scan" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
