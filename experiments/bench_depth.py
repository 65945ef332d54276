"""How exact is the depth, against OpenCV's, on a breast-like dome and at sharp depth edges?

The dome: RMSE of the depth at 540 mm, three textures and three noise levels, away from its steep rim, where both have a
value. The edges: shares of wrong pixels, of those matched and of all once holes are filled from the background.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32

from breastscan.cloud.segment import segment_breast
from breastscan.vision.camera import RectifiedPair
from breastscan.vision.refine import refine
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.depth_edges import EdgePair, edge_pair
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
EDGE_NOISES = (1.0, 3.0)
ERRORS_PX = (0.5, 1.0, 2.0)


def rows() -> list[Row]:
    """Both tables, against OpenCV's eight-path mode."""
    return dome_rows() + edge_rows()


def dome_rows() -> list[Row]:
    """Depth RMSE on the dome [mm]."""
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
    matched = disparity_map(pair.left, pair.right, StereoConfig())
    mask = segment_breast(triangulate(matched, pair)).mask
    refined = refine(pair.left, pair.right, matched, mask).disparity
    peer = opencv_disparity(pair.left, pair.right)
    from_axis = np.linalg.norm(scene.points[..., :2] - scene.sphere_centre[:2], axis=-1)
    skin = scene.on_dome & scene.seen_twice & (from_axis < scene.dome_radius - RIM)
    both = skin & np.isfinite(matched) & np.isfinite(peer)

    def rmse_mm(disparity: Float32[np.ndarray, "h w"]) -> float:
        depth = scene.focal_px * scene.baseline / disparity[both]
        return float(1e3 * np.sqrt(np.mean((depth - scene.points[..., 2][both]) ** 2)))

    return rmse_mm(matched), rmse_mm(refined), rmse_mm(peer)


def edge_rows() -> list[Row]:
    """Wrong pixels at depth edges [%]."""
    table = []
    for noise in EDGE_NOISES:
        pair = edge_pair(noise=noise)
        own = _wrong_percent(disparity_map(pair.left, pair.right, StereoConfig()), pair)
        peer = _wrong_percent(opencv_disparity(pair.left, pair.right), pair)
        table += [
            (f"depth edges, noise {noise:.0f}, {what} [%]", own[what], peer[what], peer[what] / own[what])
            for what in own
        ]
    return table


def _wrong_percent(disparity: Float32[np.ndarray, "h w"], pair: EdgePair) -> dict[str, float]:
    """Share of pixels off by more than each of `ERRORS_PX`; left columns that no full search reaches are left out."""
    reach = StereoConfig().min_disparity + StereoConfig().num_disparities
    searched = np.zeros(disparity.shape, bool)
    searched[:, reach:] = True
    known = searched & pair.seen_twice & np.isfinite(disparity)

    def percent(estimate: Float[np.ndarray, "h w"], where: Bool[np.ndarray, "h w"], limit: float) -> float:
        return float(100 * np.mean(np.abs(estimate - pair.disparity)[where] > limit))

    filled = filled_from_background(disparity)
    return {f"off by {limit} px, matched": percent(disparity, known, limit) for limit in ERRORS_PX} | {
        f"off by {limit} px, filled": percent(filled, searched, limit) for limit in ERRORS_PX
    }


def filled_from_background(disparity: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Every hole takes the smaller of the nearest known disparities left and right of it: the surface behind."""
    filled = disparity.copy()
    for row in filled:
        known = np.flatnonzero(np.isfinite(row))
        if len(known):
            holes = np.flatnonzero(np.isnan(row))
            after = np.searchsorted(known, holes)
            right = row[known[np.minimum(after, len(known) - 1)]]
            left = row[known[np.maximum(after - 1, 0)]]
            row[holes] = np.minimum(left, right)
    return filled


if __name__ == "__main__":
    for what, own, peer, ratio in rows():
        print(f"{what:60s} {own:8.3f} {peer:8.3f} {ratio:6.2f}x")
