"""A scan with a robot whose cell is described as a scene: does hardware do what the twin does?

The scene gives the mount, the payload, and the shapes that the arm must keep clear of; for `breastscan twin` its
cameras as well. Nothing of it knows the truth here.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from breastscan.camera.choice import open_camera
from breastscan.camera.interface import StereoCamera
from breastscan.commands import scan_robot
from breastscan.commands.scan_robot import RobotScan
from breastscan.commands.scan_twin import seeded
from breastscan.robot.ur.rtde_robot import RtdeConfig
from breastscan.robot.ur.worker import LinkLimits
from breastscan.scan import ScanConfig
from breastscan.vision.camera import StereoRig
from sim.cameras.camera import SimStereoCamera
from sim.room.clearance import Clearance
from sim.scene import Scene, SceneConfig
from sim.wrist.probe import payload

TWIN = "twin"
"""Option that names the scene's own cameras."""


@dataclass(frozen=True, kw_only=True)
class CellScan:
    """How a robot is reached, and what it may do."""

    robot: str
    """rtde://HOST."""
    camera: str = TWIN
    """`TWIN`, or one of `breastscan.camera.choice.FORMS`."""
    calibration: Path | None = None
    """File of the arm's own kinematics."""
    rig: Path | None = None
    """File of the cameras' calibration; None for the scene's."""
    dry_run: bool = False
    """Whether to travel the path in the air."""
    consent: bool = False
    """Whether the user has agreed to the contact beforehand."""
    link: LinkLimits = field(default_factory=LinkLimits)
    """How late robot and program may be for each other."""


def run(
    out: Path, options: CellScan, *, seed: int, config: ScanConfig, scene_config: SceneConfig, console: Console
) -> dict[str, Any]:
    """Scan with the robot, and leave a run folder in `out`; see `breastscan.commands.scan_robot.run`."""
    host = scan_robot.host_of(options.robot)
    scene = Scene(seeded(scene_config, seed))
    robot = RtdeConfig(
        host=host,
        X_FP=scene.X_FP,
        payload=payload(scene.config.mount_angle),
        limits=options.link,
        calibration=options.calibration,
    )
    setup = RobotScan(
        robot=robot,
        rig=scene.rig if options.rig is None else StereoRig.load(options.rig),
        clearances=Clearance(scene, with_chest=False),
        dry_run=options.dry_run,
        consent=options.consent,
    )

    def eyes() -> StereoCamera:
        return SimStereoCamera(scene) if options.camera == TWIN else open_camera(options.camera)

    settings = {"seed": seed, "cell": options, "scene": scene.config}
    return scan_robot.run(out, setup, eyes, config, settings, console)
