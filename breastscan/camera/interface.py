"""What a stereo camera must offer, be it simulated, read from files or real."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8


@dataclass(frozen=True, kw_only=True)
class StereoPair:
    """Two grey images taken at the same instant, as the sensors saw them (distorted, not
    rectified).
    """

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h2 w2"]
    """Of the same size, or rectification refuses the pair."""
    time: float
    """Clock of the camera [s]."""


@runtime_checkable
class StereoCamera(Protocol):
    """Two synchronised cameras."""

    def capture(self) -> StereoPair:
        """Take one pair.

        Raises:
            PerceptionError: No pair could be taken.
        """
        ...
