"""A force law of one's own holds the probe on a short loop near the top of the breast: phases,
bounds and supervisor stay what they are.
"""

import math
from dataclasses import dataclass

from breastscan import ScanConfig, scan
from breastscan.control.contact import ContactConfig
from breastscan.control.force_law import Measurement, Reference
from breastscan.planning.pattern import PatternConfig
from breastscan.scan import PlanningConfig
from sim import SceneConfig, Twin


@dataclass(frozen=True)
class Relative:
    """Speed in proportion to the logarithm of the force ratio."""

    gain: float = 0.02  # [m/s]

    def begin(self, force: float) -> float:
        """The memory: a low-passed force [N]."""
        return force

    def speed(
        self, measurement: Measurement, reference: Reference, memory: float
    ) -> tuple[float, float]:
        """Towards the reference, and the memory after it."""
        force = memory + 0.2 * (measurement.force - memory)
        return self.gain * math.log(max(reference.force, 0.1) / max(force, 0.1)), force


config = ScanConfig(
    planning=PlanningConfig(pattern=PatternConfig(height_fraction=0.85)),
    contact=ContactConfig(law=Relative()),
)
with Twin(SceneConfig(), seed=0) as twin:
    result = twin.measured(scan(twin.robot, twin.camera, twin.cell, config))

print(f"force error {result.metrics['force_rmse_n']:.2f} N RMS about the loop")
