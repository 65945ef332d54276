"""What the simulation and the viewer tell each other, in Studio's own kinds of message."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from mujoco.studio.messages import Event, Snapshot


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanSnapshot(Snapshot):
    """How far the scan is, and what its probe felt so far."""

    stage: str
    """What is being done."""
    fraction: float
    """Fraction of it that is done, 0 to 1."""
    time: Float[np.ndarray, "n"]
    """Robot's clock [s]."""
    force: Float[np.ndarray, "n"]
    """Measured contact force along the probe [N]."""
    depth_mm: Float[np.ndarray, "n"]
    """Largest inward displacement of the skin [mm]."""
    X_BP: Float[np.ndarray, "4 4"]
    """Where the probe is now."""
    results: tuple[tuple[str, str], ...] = ()
    """Names and values of the finished scan's metrics."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturesSnapshot(Snapshot):
    """What the two cameras see now."""

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h2 w2"]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanEvent(Event):
    """The path that was planned."""

    loop_B: Float[np.ndarray, "n 3"]
    """Points along it [m]; it closes without repeating its first point."""


@dataclass(frozen=True, kw_only=True)
class PaceSnapshot(Snapshot):
    """How fast the user wants it."""

    paused: bool
    speed: float
    """Simulated over wall time [-]."""


START = PaceSnapshot(paused=True, speed=1.0)
"""The user starts the scan: a browser may take long to load the scene."""
