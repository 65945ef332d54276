"""The drag that planning foretells, against the twin's own tissue."""

from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Float

from breastscan.geometry.plane import Plane
from breastscan.tissue.drag import PressedBreast, TissueConfig
from breastscan.tissue.shape import StarShape
from sim.tissue.phantom import Phantom, PhantomConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from tests.sim.tissue.press_poses import REST, loop_pose

DEPTHS = (0.003, 0.006)
"""[m]"""
AZIMUTHS = np.radians([20, 80, 140, 200, 260, 320])
SEEN_FROM = 2.5e-3
"""Skin below this height is not told from the chest [m]."""
NOISE = 2e-4
"""Of the perceived points [m]."""


@dataclass(frozen=True)
class Pressed:
    """One breast, and what is foretold of its drag."""

    phantom: Phantom
    tissue: SoftTissue
    truth: Truth
    drag_S: Float[np.ndarray, "k 3"]

    def miss(self, place: int, depth: float, share: float) -> float:
        """Distance from the point that is meant to the one that is touched, with the tip moved by
        a share of what is foretold [m].
        """
        X_SP = loop_pose(self.phantom, AZIMUTHS[place], depth)
        meant_S = X_SP[:3, 3] - depth * X_SP[:3, 2]
        X_SP[:3, 3] += share * depth**1.5 * self.drag_S[place]
        self.tissue.press(X_SP, REST)
        return float(np.linalg.norm(self.truth.material_point(X_SP[None, :3, 3])[0] - meant_S))


def cloud(phantom: Phantom) -> Float[np.ndarray, "n 3"]:
    """Skin as it is perceived [m]."""
    rng = np.random.default_rng(8)
    direction = rng.standard_normal((4000, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    points_S = phantom.embed(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    return points_S[points_S[:, 2] > SEEN_FROM] + NOISE * rng.standard_normal(3)


@pytest.fixture(
    scope="module",
    params=[PhantomConfig(), PhantomConfig(breast="fatty", seed=11, ptosis=1.4)],
    ids=["standard", "fatty"],
)
def pressed(request) -> Pressed:
    phantom = Phantom(request.param)
    tissue = SoftTissue.build(phantom)
    shape = StarShape.fit(cloud(phantom), Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.0))
    poses = np.stack([loop_pose(phantom, azimuth, 0.0) for azimuth in AZIMUTHS])
    drag_S = PressedBreast(shape.embed, TissueConfig()).drag(poses)
    return Pressed(phantom, tissue, Truth(phantom, tissue), drag_S)


@pytest.mark.parametrize("depth", DEPTHS)
def test_moved_by_what_is_foretold_the_probe_touches_what_is_meant(pressed, depth):
    """Six millimetres deep it misses by a fifth of a millimetre, without the shift by one."""
    places = range(len(AZIMUTHS))
    shifted = np.array([pressed.miss(place, depth, share=1.0) for place in places])
    unshifted = np.array([pressed.miss(place, depth, share=0.0) for place in places])
    assert np.sqrt(np.mean(shifted**2)) < 0.03 * depth
    assert np.sqrt(np.mean(shifted**2)) < 0.25 * np.sqrt(np.mean(unshifted**2))
