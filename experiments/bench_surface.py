"""How near to the truth is the skin that one pair shows, how sure is it of that, and how long does
it take?

Errors are taken where both cameras see skin, evenly over its area; how long a pair takes to a path
with normals is the processor time of one thread, everything compiled and in its caches.
"""

import time
from dataclasses import replace

import numpy as np

from breastscan.camera.interface import StereoPair
from breastscan.geometry import se3
from breastscan.geometry.skin import Skin
from breastscan.planning.pattern import PatternConfig, half_height_loop
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


def row(name: str, breast: str, seed: int) -> str:
    """One breast of the default scene, as a line of the table."""
    config = SceneConfig()
    config = replace(config, phantom=replace(config.phantom, breast=breast)).seeded(seed)
    scene = Scene(config)
    camera = SimStereoCamera(scene)
    images = camera.capture()
    camera.close()
    seconds, seen = min((_timed(images, scene) for _ in range(REPEATS)), key=lambda pair: pair[0])
    X_SL = se3.inverse(scene.X_BS_at(images.time)) @ scene.rig.X_BL
    truth = Truth(scene.phantom, None)  # pyright: ignore[reportArgumentType] (nothing is pressed)
    found = np.isfinite(seen.points_L[..., 0])
    both = seen_by_both(seen.pair, scene.rig, X_SL, truth)
    points_mm = 1e3 * truth.distance(se3.transform(X_SL, seen.points_L[found]))
    hits_S = truth.cast(X_SL[:3, 3], _rays(seen.pair, both) @ X_SL[:3, :3].T)
    off, tilt, weight = _errors(seen.skin.seen_from(X_SL), hits_S, truth, X_SL[:3, 3])
    sigma = seen.skin.sigma(seen.skin.chart(se3.transform(se3.inverse(X_SL), hits_S)))
    order = np.argsort(tilt)
    worst = tilt[order][np.searchsorted(np.cumsum(weight[order]), 0.95)]
    grid = np.stack(np.meshgrid(*(np.linspace(-0.6, 0.6, 241),) * 2), axis=-1).reshape(-1, 2)
    top_mm = 1e3 * (seen.skin.seen_from(X_SL).points(grid)[:, 2].max() - scene.phantom.height)
    return (
        f"| {name} | {rms(points_mm):.3f} | {100 * found[both].mean():.1f} | "
        f"{1e3 * np.sqrt(np.sum(weight * off**2)):.3f} | {np.sum(weight * tilt):.2f} / "
        f"{worst:.2f} | {np.sqrt(np.sum(weight * (off / sigma) ** 2)):.2f} | {top_mm:+.2f} | "
        f"{seconds:.2f} |"
    )


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
    print(HEADER)
    for scene in SCENES:
        print(row(*scene), flush=True)
