"""How exact is the depth, against OpenCV's, on a breast-like dome?

RMSE of the depth at 540 mm, three textures and three noise levels, away from its steep rim, where
both have a value.
"""

import numpy as np
from jaxtyping import Float32

from breastscan.cloud.segment import segment_breast
from breastscan.vision.camera import RectifiedPair
from breastscan.vision.refine import refine
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.opencv_stereo import opencv_disparity
from experiments.ray_cast_dome import DomeScene

Row = tuple[str, float, float, float]
"""What was measured, ours, theirs, and how many times better ours is."""
RIM = 0.01
"""Skin nearer than this to the dome's rim is left out [m]."""
SCENES = {
    "speckle": DomeScene(),
    "skin": DomeScene(texture="skin"),
    "low texture": DomeScene(contrast=0.04),
}
NOISES = (0.0, 1.0, 2.0)
"""Standard deviations [grey levels]."""
MIN_DISPARITY, NUM_DISPARITIES = 64, 128
"""Searched by both [px]."""


def rows() -> list[Row]:
    """Depth RMSE [mm], against OpenCV's eight-path mode."""
    table = []
    for texture, scene in SCENES.items():
        for noise in NOISES:
            matched, refined, peer = _dome_errors(scene, scene.pair(noise=noise))
            label = f"{texture}, noise {noise:.0f}, depth RMSE [mm]"
            table += [(f"{label}, matched", matched, peer, peer / matched)]
            table += [(f"{label}, refined", refined, peer, peer / refined)]
    return table


def _dome_errors(scene: DomeScene, pair: RectifiedPair) -> tuple[float, float, float]:
    """RMSE of our match, of its refinement and of OpenCV's match [mm]."""
    matched = disparity_map(
        pair.left,
        pair.right,
        StereoConfig(min_disparity=MIN_DISPARITY, num_disparities=NUM_DISPARITIES),
    )
    mask = segment_breast(triangulate(matched, pair)).mask
    refined = refine(pair.left, pair.right, matched, mask).disparity
    peer = opencv_disparity(pair.left, pair.right, MIN_DISPARITY, NUM_DISPARITIES)
    from_axis = np.linalg.norm(scene.points[..., :2] - scene.sphere_centre[:2], axis=-1)
    skin = scene.on_dome & scene.seen_twice & (from_axis < scene.dome_radius - RIM)
    both = skin & np.isfinite(matched) & np.isfinite(peer)

    def rmse_mm(disparity: Float32[np.ndarray, "h w"]) -> float:
        depth = scene.focal_px * scene.baseline / disparity[both]
        return float(1e3 * np.sqrt(np.mean((depth - scene.points[..., 2][both]) ** 2)))

    return rmse_mm(matched), rmse_mm(refined), rmse_mm(peer)


if __name__ == "__main__":
    for what, own, peer, ratio in rows():
        print(f"{what:60s} {own:8.3f} {peer:8.3f} {ratio:6.2f}x")
