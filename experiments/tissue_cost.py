"""What the soft phantom costs: its first build, the cache, a press, and how much its mesh shows
in the force.
"""

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from jaxtyping import Float

from experiments.indentation import axial_force, pose
from sim.tissue.compliance import compute_compliance
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.soft import SoftTissue

CASES = {
    "standard, first time": PhantomConfig(),
    "the same from the cache": PhantomConfig(),
    "another stiffness and size": PhantomConfig(young=15e3, size=1.1),
    "another class": PhantomConfig(breast="scattered"),
}
FINER = (800, 1600)
"""Finite-element vertices on the skin that the default is held against."""
PLACES = np.linspace(0, 2 * np.pi, 8, endpoint=False)
HEIGHTS, ROLLS_DEG = (0.3, 0.5, 0.7), tuple(range(0, 180, 15))
"""Contours, over the breast's height, and rolls of the probe in which it slides along them: at 0
the array lies along the path, at 90 across it [deg]."""
SLIDE_DEPTH = 0.006
"""About 5 N [m]."""
SLIDE_STEP = 2.5e-4
"""[m]"""
LONGEST_RIPPLE = 0.010
"""Wavelength below which the force's variation counts as ripple [m]."""


@dataclass(frozen=True, kw_only=True)
class Build:
    """One tissue built."""

    cpu: float
    """[s]"""
    megabytes: float
    """On disk afterwards, all that was built until then."""


@dataclass(frozen=True, kw_only=True)
class Slide:
    """A probe slid once around at constant depth, across the path or along it."""

    force: Float[np.ndarray, "n"]
    """Axial force every `SLIDE_STEP` or so [N]."""
    length: float
    """Of the path [m]."""
    press: float
    """CPU time of a press [s]."""

    @property
    def ripple(self) -> float:
        """RMS of the force's variation at wavelengths below `LONGEST_RIPPLE` [N]."""
        spectrum = np.fft.rfft(self.force)
        spectrum[: int(np.ceil(self.length / LONGEST_RIPPLE))] = 0
        return float(np.fft.irfft(spectrum, len(self.force)).std())


def builds() -> dict[str, Build]:
    """Build each of `CASES` in turn, with a cache that is empty at first."""
    found = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict(os.environ, {"XDG_CACHE_HOME": folder}),
    ):
        for name, config in CASES.items():
            start = time.process_time()
            SoftTissue.build(Phantom(config))
            spent = time.process_time() - start
            size = sum(file.stat().st_size for file in Path(folder).rglob("*.npz"))
            found[name] = Build(cpu=spent, megabytes=size / 1e6)
    return found


def convergence(
    phantom: Phantom, soft: SoftTissue, depths: Float[np.ndarray, "n"]
) -> dict[int, Float[np.ndarray, "n"]]:
    """Largest relative change of the force at each depth, over `PLACES`, where the finite
    elements are finer.
    """

    def forces(tissue: SoftTissue) -> np.ndarray:
        return np.array(
            [
                [axial_force(tissue, pose(phantom, place, depth)) for place in PLACES]
                for depth in depths
            ]
        )

    usual = forces(soft)
    return {
        points: np.abs(
            usual / forces(SoftTissue(phantom, compute_compliance(phantom, points))) - 1
        ).max(axis=1)
        for points in FINER
    }


def slide(phantom: Phantom, soft: SoftTissue, height: float, roll: float) -> Slide:
    """Slide the probe around a contour of the breast, in even steps."""
    loop_S = phantom.level_loop(height * phantom.height, 4000)
    along = np.linalg.norm(np.roll(loop_S, -1, axis=0) - loop_S, axis=1)
    length = float(along.sum())
    azimuths = 2 * np.pi * np.arange(4001) / 4000
    even = np.arange(0, length, length / round(length / SLIDE_STEP))[: round(length / SLIDE_STEP)]
    places = np.interp(even, np.append(0, np.cumsum(along)), azimuths)
    poses = [pose(phantom, place, SLIDE_DEPTH, height, roll) for place in places]
    start = time.process_time()
    force = np.array([axial_force(soft, X_SP) for X_SP in poses])
    return Slide(force=force, length=length, press=(time.process_time() - start) / len(poses))
