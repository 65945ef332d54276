"""How far from the point that is meant does the probe touch, with its tip moved by the drag that is
foretold from the perceived shape?

Breasts of every class and size, pressed in places of their half-height loops at 5 N; the shape is
perceived as a cloud with noise, from 2.5 mm over the chest on. Then the same with tissue that is
not what the model takes it for: another Poisson's ratio, a gland, the skin's membrane, at the depth
that plain tissue has at 5 N.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from breastscan.geometry.plane import Plane
from breastscan.planning.motion import DRAG_EXPONENT
from breastscan.tissue.drag import PressedBreast, TissueConfig
from breastscan.tissue.shape import StarShape
from experiments.indentation import axial_force, pose
from sim.tissue.breast import SHAPES
from sim.tissue.layers import LayerConfig
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth

FORCE = 5.0
"""[N]"""
DEEPEST = 0.02
"""[m]"""
BISECTIONS = 16
PLACES = 16
"""Of each loop."""
POINTS = 4000
"""Of the perceived cloud."""
NOISE = 2e-4
"""Of each of its points [m]."""
LOWEST = 2.5e-3
"""Over the chest [m]."""
OTHERS = {
    "Poisson's ratio .40": {"poisson": 0.40},
    "Poisson's ratio .49": {"poisson": 0.49},
    "gland, 3 x": {"layers": LayerConfig(gland_fraction=0.6)},
    "skin, 10 x": {"layers": LayerConfig(skin_ratio=10.0)},
    "skin, 69 x": {"layers": LayerConfig(skin_ratio=69.0)},
    "gland, 3 x, and skin, 69 x": {"layers": LayerConfig(gland_fraction=0.6, skin_ratio=69.0)},
}
"""What the tissue may be."""


@dataclass(frozen=True, kw_only=True)
class Foretold:
    """A breast, and the drag that its perceived shape foretells."""

    config: PhantomConfig
    X_SP: Float[np.ndarray, "k 4 4"]
    """The probe in each place, its tip on the skin."""
    drag_S: Float[np.ndarray, "k 3"]

    def misses(
        self, tissue: SoftTissue, depths: Float[np.ndarray, "k"], share: float
    ) -> Float[np.ndarray, "k"]:
        """Distance from the point that is meant to the one that is touched, the tip moved by a
        share of what is foretold [m].
        """
        truth = Truth(Phantom(self.config), tissue)
        found = []
        for X_SP, drag_S, depth in zip(self.X_SP, share * self.drag_S, depths, strict=True):
            X = _pressed(X_SP, drag_S, depth)
            tissue.press(X, np.zeros(3))
            touched_S = truth.material_point(X[None, :3, 3])[0]
            found.append(np.linalg.norm(touched_S - X_SP[:3, 3]))
        return np.array(found)

    def depths(self, tissue: SoftTissue, share: float) -> Float[np.ndarray, "k"]:
        """How deep the probe lies at `FORCE` [m]."""
        low, high = np.zeros(len(self.X_SP)), np.full(len(self.X_SP), DEEPEST)
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            forces = [
                axial_force(tissue, _pressed(X_SP, share * drag_S, depth))
                for X_SP, drag_S, depth in zip(self.X_SP, self.drag_S, middle, strict=True)
            ]
            low, high = np.where(np.array(forces) < FORCE, [middle, high], [low, middle])
        return low


def breasts(seed: int) -> Iterator[tuple[str, PhantomConfig]]:
    """The default breast in three seeds, and twelve drawn as `study population` draws them."""
    for default in range(3):
        yield f"standard, seed {default}", PhantomConfig(seed=default)
    rng = np.random.default_rng(seed)
    for number in range(12):
        breast = list(SHAPES)[number % len(SHAPES)]
        share = rng.uniform(size=5)
        config = PhantomConfig(
            breast=breast,
            size=0.85 + 0.3 * share[0],
            projection=0.85 + 0.3 * share[1],
            ptosis=0.5 + share[2],
            asymmetry=0.5 + share[3],
            young=20e3 + 20e3 * share[4],
            seed=100 + number,
        )
        yield f"{breast}, {number}", config


def foretell(config: PhantomConfig, seed: int) -> Foretold:
    """The drag of a breast, from a cloud of its skin."""
    phantom, rng = Phantom(config), np.random.default_rng(seed)
    direction = rng.standard_normal((POINTS, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    points_S = phantom.embed(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    points_S = points_S[points_S[:, 2] > LOWEST]
    points_S += NOISE * rng.standard_normal(points_S.shape)
    shape = StarShape.fit(points_S, Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.0))
    azimuths = 2 * np.pi * np.arange(PLACES) / PLACES
    X_SP = np.stack([pose(phantom, azimuth, 0.0) for azimuth in azimuths])
    drag_S = PressedBreast(shape.embed, TissueConfig()).drag(X_SP)
    return Foretold(config=config, X_SP=X_SP, drag_S=drag_S)


def rows(seed: int = 77) -> Iterator[tuple[str, str, str, str]]:
    """What was pressed, how deep [mm], and how far off it was touched, without and with the drag:
    RMS and largest [mm].
    """
    for name, config in breasts(seed):
        foretold, tissue = foretell(config, seed), SoftTissue.build(Phantom(config))
        depths = [foretold.depths(tissue, share) for share in (0.0, 1.0)]
        misses = [foretold.misses(tissue, depths[share], share) for share in (0, 1)]
        yield name, f"{1e3 * depths[1].mean():.1f}", _told(misses[0]), _told(misses[1])
        if name not in ("standard, seed 0", "dense, 1", "fatty, 4"):
            continue
        for other, change in OTHERS.items():
            changed = SoftTissue.build(Phantom(replace(config, **change)))
            misses = [foretold.misses(changed, depths[0], share) for share in (0, 1)]
            yield f"{name}, {other}", "", _told(misses[0]), _told(misses[1])


def _pressed(
    X_SP: Float[np.ndarray, "4 4"], drag_S: Float[np.ndarray, "3"], depth: float
) -> Float[np.ndarray, "4 4"]:
    X = X_SP.copy()
    X[:3, 3] += depth * X_SP[:3, 2] + depth**DRAG_EXPONENT * drag_S
    return X


def _told(misses: Float[np.ndarray, "k"]) -> str:
    return f"{1e3 * np.sqrt(np.mean(misses**2)):.3f} / {1e3 * misses.max():.3f}"


if __name__ == "__main__":
    print("| breast | depth [mm] | without [mm] | with [mm] |\n|---|---|---|---|")
    for row in rows():
        print(f"| {' | '.join(row)} |", flush=True)
