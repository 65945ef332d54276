"""How late is the servo really? A lead that is off by 4 ms costs .1 mm at 25 mm/s, so the joints'
own motion tells.

An arm that trails its targets by more than was assumed lies behind where it is expected, along its
joint speed: the ratio, by least squares over the last seconds, is the missing time.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

MEMORY_TIME = 3.0
"""Time constant with which old motion is forgotten [s]."""
PRIOR = 2e-3
"""Weight of the nominal lag: the squared joint speed of a slow path, over half a second
[rad^2/s]."""
MAX_CORRECTION = 0.5
"""Of the lag, over the nominal one, in both directions [-]."""


@dataclass(frozen=True)
class LagEstimate:
    """The servo's lag, as estimated from the motion."""

    nominal: float
    """Lag that is assumed before [s]."""
    targets: tuple[Float[np.ndarray, "6"], ...]
    """Those of the last periods, the latest first [rad]."""
    behind: float = 0.0
    """Sum of how far the joints lay behind, times their speed [rad^2]."""
    squared: float = 0.0
    """Sum of their squared speed [rad^2/s]."""

    @staticmethod
    def resting(q: Float[np.ndarray, "6"], nominal: float, period: float) -> "LagEstimate":
        """Of an arm at rest at `q` [rad]."""
        return LagEstimate(nominal, (q,) * (math.ceil(nominal / period) + 2))

    @property
    def lag(self) -> float:
        """The best guess [s]."""
        bound = MAX_CORRECTION * self.nominal
        return self.nominal + min(max(self.behind / (self.squared + PRIOR), -bound), bound)

    def after(
        self, target: Float[np.ndarray, "6"], q: Float[np.ndarray, "6"], period: float
    ) -> "LagEstimate":
        """One period [s] later: `target` was sent, and the joints then were at `q` [rad]."""
        targets = (target, *self.targets[:-1])
        back = self.nominal / period
        newer, older = targets[int(back)], targets[int(back) + 1]
        step = newer - older
        expected = newer - (back - int(back)) * step
        kept = 1.0 - period / MEMORY_TIME
        behind = kept * self.behind + float(step @ (expected - q))
        return LagEstimate(
            self.nominal, targets, behind, kept * self.squared + float(step @ step) / period
        )
