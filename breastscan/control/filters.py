"""Low-pass of the measured force, and of its change."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Filtered:
    """A force as it comes out of the low-pass, and how fast it changes."""

    force: float = 0.0
    """[N]"""
    change: float = 0.0
    """[N/s]"""

    def after(self, measured: float, corner_hz: float, period: float) -> "Filtered":
        """One period [s] later, with a new measurement [N].

        The force passes one low-pass of first order, its change a second one with the same corner
        [Hz].
        """
        weight = 1.0 - math.exp(-2.0 * math.pi * corner_hz * period)
        force = self.force + weight * (measured - self.force)
        change = self.change + weight * ((force - self.force) / period - self.change)
        return Filtered(force, change)
