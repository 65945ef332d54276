"""Scans of a printed breast by the twin, from which most items are taken: with realistic errors and
without, at the scan's force and at a fifth of it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from breastscan.control.contact import ContactConfig
from breastscan.control.phases import PhaseConfig
from breastscan.control.surface import SurfaceConfig
from breastscan.geometry import se3
from breastscan.scan import ScanConfig, ScanResult, Stages, match, scan
from breastscan.vision import triangulation
from breastscan.vision.camera import StereoRig
from sim.arm.deviations import ArmConfig
from sim.cameras.camera_errors import CameraConfig
from sim.scene import Scene, SceneConfig
from sim.tissue.phantom_config import PhantomConfig
from sim.truth import Truth
from sim.twin import Twin
from sim.wrist.wrench_errors import WrenchSensorConfig

FORCES = (5.0, 1.0)
"""Set-points [N]: the scan's own, and one at which the probe's silicone hardly gives."""
APPROACH_SPEED = 0.003
"""Onto a rigid body [m/s]."""
PRINT_STIFFNESS = 7000.0
"""Of the print, told beforehand as docs/twin.md does [N^(2/3)/m]: else the probe bounces first."""
PRINT = PhantomConfig(mechanics="printed")
REALISTIC = SceneConfig(
    phantom=PRINT,
    arm=ArmConfig(kinematics="calibrated"),
    camera=CameraConfig(quality="realistic"),
    wrist=WrenchSensorConfig(quality="industrial"),
)
"""Cameras as the paper's sensor and a lens are, an arm whose calibration was read, a six-axis
sensor; and the rig as it was estimated."""
EXACT = SceneConfig(
    phantom=PRINT,
    camera=CameraConfig(quality="ideal"),
    wrist=WrenchSensorConfig(quality="ideal"),
)
"""No error but the 256 grey levels."""


@dataclass(frozen=True, kw_only=True)
class Scanned:
    """One scan and the truth about it."""

    name: str
    force: float
    """Set-point [N]."""
    scene: Scene
    result: ScanResult
    """With the true force in its trajectory and the errors in its metrics."""
    truth: Truth

    @property
    def X_BL(self) -> Float[np.ndarray, "4 4"]:
        """Where the scan took the left camera to be in the base [m]."""
        X_BL = self.result.cell.rig.X_BL
        assert X_BL is not None, "a cell's rig has its place in the base"
        return X_BL

    @property
    def X_SL(self) -> Float[np.ndarray, "4 4"]:
        """The same in the phantom [m]."""
        return se3.inverse(self.scene.X_BS) @ self.X_BL

    def in_base_mm(self, points_L: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Points of the left camera in B [mm], as the scan sees them."""
        return 1e3 * se3.transform(self.X_BL, points_L)

    def errors_mm(self, points_L: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distances of points from the true skin [mm]."""
        return 1e3 * self.truth.distance(se3.transform(self.X_SL, points_L))


@dataclass(frozen=True, kw_only=True)
class Matched:
    """The breast before it is refined and denoised, as the paper has it."""

    disparity: Float32[np.ndarray, "h w"]
    """Of the whole view [px], NaN where unknown."""
    found: Bool[np.ndarray, "h w"]
    """Pixels of the breast that have a point."""
    points_L: Float[np.ndarray, "n 3"]
    """Those points [m]."""


def scanned(
    scene: SceneConfig, force: float, *, seed: int, rig: StereoRig | None = None
) -> Scanned:
    """Scan a printed breast, and hold the scan against the truth."""
    contact = ContactConfig(
        force=force,
        phases=PhaseConfig(approach_speed=APPROACH_SPEED),
        surface=SurfaceConfig(stiffness=PRINT_STIFFNESS),
    )
    with Twin(scene, seed=seed, rig=rig) as twin:
        result = scan(
            twin.robot,
            twin.camera,
            twin.cell,
            ScanConfig(contact=contact),
        )
        return Scanned(
            name=f"errors {'off' if rig is None else 'on'}, {force:g} N",
            force=force,
            scene=twin.scene,
            result=twin.measured(result),
            truth=twin.truth,
        )


def matched(scan: Scanned) -> Matched:
    """Match a scan's pair again, and leave it at that."""
    result = scan.result
    pair, disparity = match(result.images, result.cell.rig, result.config.perception, Stages())
    points_L = triangulation.triangulate(disparity, pair)
    found = result.reconstruction.breast.mask & np.isfinite(points_L[..., 0])
    return Matched(disparity=disparity, found=found, points_L=points_L[found])
