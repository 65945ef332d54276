"""How soft is the skin? A fit over the first second of a contact, in which the force rises on one
spot.

The indentation is c f^m for a force f, and meanwhile the skin moves smoothly, as a chest that
breathes does:

    tip = a_0 + a_1 t + a_2 t^2 + a_3 t^3 + c f^m.

Tip and f^m pass the same low-pass, which changes nothing of that, but keeps the sensor's noise
from making c smaller. What the power is wrong by, the cubic takes for a motion of the skin, so that
c follows the slope of the indentation over the force while that rises; .3 mm of error are left. The
observer, which goes on from sample to sample, is of less use for this: it mistakes .3 to 2 mm of
the skin's place for stiffness, and does not find out at a constant force.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

POWER = 0.62
"""m, of the force in the indentation. An elastic half-space has 2/3 [Johnson, Ch. 4]; tissue on a
chest grows stiffer as it is pressed against it: .54 to .70 on the twin's breasts, less by .04 where
its damping acts while the force rises."""
FIT_HZ = 20.0
"""Corner of the low-pass in front of the fit [Hz]."""
FIT_TIME = 0.6
"""Shorter than this the fit is not used [s]: the force rises in .35 s."""
FIT_ROOT = 1.5
"""How many times f^m must have grown for it [-]: from .5 to 5 N it does 4.2 times."""
DEEPEST = 0.025
"""Indentation that a fit may claim [m]: the supervisor's bound of the penetration."""


@dataclass(frozen=True)
class SettleFit:
    """The fit for the indentation, while the force rises on one spot."""

    time: float
    """Since it began [s]."""
    tip: float
    """Low-passed place of the tip [m]."""
    root: float
    """Low-passed f^m [N^m]."""
    first: float
    """What that was at first contact."""
    moments: Float[np.ndarray, "6 6"]
    """Sums of the products of (1, t, t^2, t^3, root, tip)."""

    @staticmethod
    def beginning(tip: float, root: float) -> "SettleFit":
        """At first contact, with the tip there [m] and that f^m."""
        return SettleFit(0.0, tip, root, root, np.zeros((6, 6)))

    def after(self, tip: float, root: float, period: float) -> "SettleFit":
        """One period [s] later."""
        weight = 1.0 - math.exp(-2.0 * math.pi * FIT_HZ * period)
        tip = self.tip + weight * (tip - self.tip)
        root = self.root + weight * (root - self.root)
        row = np.array([1.0, self.time, self.time**2, self.time**3, root, tip])
        moments = self.moments + np.outer(row, row)
        return SettleFit(self.time + period, tip, root, self.first, moments)

    def softness(self, observed: float) -> float:
        """c, or the observer's where the fit tells nothing [m/N^m]."""
        if self.time < FIT_TIME or self.root < FIT_ROOT * self.first:
            return observed
        fit, *_ = np.linalg.lstsq(self.moments[:5, :5], self.moments[:5, 5])
        softness = float(fit[4])
        return softness if 0.0 < softness * self.root < DEEPEST else observed
