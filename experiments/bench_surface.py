"""How near to the truth is the skin that one pair shows, how sure is it of that, and how long does
it take?

Errors are taken where both cameras see skin, evenly over its area; how long a pair takes to a path
with normals is the processor time of one thread, everything compiled and in its caches.
"""

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from breastscan.camera.interface import StereoPair
from breastscan.geometry import se3
from breastscan.geometry.skin import Skin
from breastscan.planning.pattern import PatternConfig, half_height_loop
from breastscan.report import theme
from breastscan.run.metrics import rms
from breastscan.scan import PerceptionConfig, Reconstruction, Stages, perceive
from breastscan.vision.camera import RectifiedPair
from sim.cameras.camera import SimStereoCamera
from sim.error_analysis import seen_by_both
from sim.scene import Scene, SceneConfig
from sim.truth import Truth

SCENES = [
    *((f"standard, seed {seed}", "standard", seed) for seed in range(10)),
    *((breast, breast, 31) for breast in ("dense", "heterogeneous", "scattered", "fatty")),
]
"""Name, class and seed of each breast."""
MIN_COSINE = 0.1
"""Between line of sight and normal: below it a pixel counts as if it were this."""
REPEATS = 3
"""Of which the shortest time counts."""
HEADER = (
    "| breast | points, RMS [mm] | with a point [%] | skin, RMS [mm] | normals, mean / 95 % [°] | "
    "errors over sigma, RMS | top [mm] | time [s] |\n|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A breast's skin from one pair, against the truth."""

    scene: Scene
    seen: Reconstruction
    seconds: float
    """From pair to path [s]."""
    X_SL: np.ndarray
    truth: Truth
    both: np.ndarray
    """Pixels that see skin which both cameras see."""
    off: np.ndarray
    """Of the skin at these, along the normal [m]."""
    tilt: np.ndarray
    """Of its normals [deg]."""
    sigma: np.ndarray
    """What it says of itself [m]."""
    weight: np.ndarray
    """Share of the area that each pixel stands for [-]."""


def judged(breast: str, seed: int) -> Judged:
    """One breast of the default scene."""
    config = SceneConfig()
    config = replace(config, phantom=replace(config.phantom, breast=breast)).seeded(seed)
    scene = Scene(config)
    X_BL = scene.rig.X_BL
    assert X_BL is not None, "a scene's rig has its place in the base"
    camera = SimStereoCamera(scene)
    images = camera.capture()
    camera.close()
    seconds, seen = min((_timed(images, scene) for _ in range(REPEATS)), key=lambda one: one[0])
    X_SL = se3.inverse(scene.X_BS_at(images.time)) @ X_BL
    truth = Truth(scene.phantom, None)  # pyright: ignore[reportArgumentType] (nothing is pressed)
    both = seen_by_both(seen.pair, scene.rig, X_SL, truth)
    hits_S = truth.cast(X_SL[:3, 3], _rays(seen.pair, both) @ X_SL[:3, :3].T)
    off, tilt, weight = _errors(seen.skin.seen_from(X_SL), hits_S, truth, X_SL[:3, 3])
    sigma = seen.skin.sigma(seen.skin.chart(se3.transform(se3.inverse(X_SL), hits_S)))
    return Judged(
        scene=scene,
        seen=seen,
        seconds=seconds,
        X_SL=X_SL,
        truth=truth,
        both=both,
        off=off,
        tilt=tilt,
        sigma=sigma,
        weight=weight,
    )


def row(name: str, breast: str, seed: int) -> str:
    """One breast, as a line of the table."""
    one = judged(breast, seed)
    found = np.isfinite(one.seen.points_L[..., 0])
    points_S = se3.transform(one.X_SL, one.seen.points_L[found])
    order = np.argsort(one.tilt)
    worst = one.tilt[order][np.searchsorted(np.cumsum(one.weight[order]), 0.95)]
    grid = np.stack(np.meshgrid(*(np.linspace(-0.6, 0.6, 241),) * 2), axis=-1).reshape(-1, 2)
    top = one.seen.skin.seen_from(one.X_SL).points(grid)[:, 2].max()
    z = one.off / one.sigma
    return (
        f"| {name} | {rms(1e3 * one.truth.distance(points_S)):.3f} | "
        f"{100 * found[one.both].mean():.1f} | "
        f"{1e3 * np.sqrt(np.sum(one.weight * one.off**2)):.3f} | "
        f"{np.sum(one.weight * one.tilt):.2f} / {worst:.2f} | "
        f"{np.sqrt(np.sum(one.weight * z**2)):.2f} | "
        f"{1e3 * (top - one.scene.phantom.height):+.2f} | {one.seconds:.2f} |"
    )


def picture(path: Path) -> None:
    """Errors and their standard deviation over the left view, of one breast."""
    figure, axes = theme.panels(1, 3, height_in=3.2)
    one = judged("standard", 3)
    panels = (
        ("Error of the skin [mm]", 1e3 * one.off, "RdBu_r", (-0.2, 0.2)),
        ("Its standard deviation [mm]", 1e3 * one.sigma, "viridis", (0.0, 0.2)),
        ("Error of the normals [°]", one.tilt, "viridis", (0.0, 2.0)),
    )
    rows, columns = np.nonzero(one.both)
    for axis, (title, values, colours, (low, high)) in zip(axes[0], panels, strict=True):
        image = np.full(one.both.shape, np.nan)
        image[one.both] = values
        part = image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        drawn = axis.imshow(part, cmap=colours, vmin=low, vmax=high)
        figure.colorbar(drawn, ax=axis, shrink=0.8)
        axis.set_axis_off()
        theme.title(axis, title)
    figure.savefig(path, dpi=130)


def _timed(images: StereoPair, scene: Scene) -> tuple[float, Reconstruction]:
    X_BL = scene.rig.X_BL
    assert X_BL is not None, "a scene's rig has its place in the base"
    start = time.process_time()
    seen = perceive(images, scene.rig, PerceptionConfig(), Stages())
    half_height_loop(seen.skin.seen_from(X_BL), seen.breast.plate.seen_from(X_BL), PatternConfig())
    return time.process_time() - start, seen


def _rays(pair: RectifiedPair, pixels: np.ndarray) -> np.ndarray:
    """Lines of sight of pixels, in L."""
    rows, columns = np.nonzero(pixels)
    cx, cy = pair.centre_px
    rays_V = np.column_stack([columns - cx, rows - cy, np.full(len(rows), pair.focal_px)])
    return rays_V @ pair.R_LV.T


def _errors(
    skin: Skin, hits_S: np.ndarray, truth: Truth, eye_S: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Off the truth [m] and off its normal [deg], and which share of the area each stands for."""
    ab = skin.chart(hits_S)
    _, n_S = truth.closest(hits_S)
    sight_S = hits_S - eye_S
    distance = np.linalg.norm(sight_S, axis=1)
    cosine = np.maximum(-np.sum(sight_S * n_S, axis=1) / distance, MIN_COSINE)
    area = distance**2 / cosine
    tilt = np.degrees(se3.angle_between(skin.normals(ab), n_S))
    return truth.distance(skin.points(ab)), tilt, area / area.sum()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        picture(Path(sys.argv[1]))
    else:
        print(HEADER)
        for scene in SCENES:
            print(row(*scene), flush=True)
