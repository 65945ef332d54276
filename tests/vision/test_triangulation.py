"""Triangulation against projection, its inverse, and against OpenCV's."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from breastscan.vision.camera import RectifiedPair
from breastscan.vision.triangulation import triangulate
from experiments.ray_cast_dome import DomeScene
from tests.vision.projections import projections


def pair_like(height: int, width: int, R_LV: np.ndarray | None = None) -> RectifiedPair:
    image = np.zeros((height, width), np.uint8)
    return RectifiedPair(
        left=image,
        right=image,
        focal_px=684.7,
        centre_px=(width / 2 + 3.2, height / 2 - 1.7),
        baseline=0.09898,
        R_LV=np.eye(3) if R_LV is None else R_LV,
    )


def test_true_disparity_gives_the_true_dome_within_a_micrometre():
    scene = DomeScene(width_px=200, height_px=120)
    points = triangulate(scene.disparity.astype(np.float32), scene.pair(noise=0.0))
    assert np.abs(points - scene.points).max() < 1e-6


def test_points_come_out_in_the_unrectified_left_camera():
    """A view rotated by `R_LV` about the optical centre shows the same points in rotated
    coordinates.
    """
    R_LV = Rotation.from_euler("xyz", [2.0, -4.0, 1.0], degrees=True).as_matrix()
    disparity = np.full((9, 11), 120.0, np.float32)
    rotated = triangulate(disparity, pair_like(9, 11, R_LV))
    np.testing.assert_allclose(rotated @ R_LV, triangulate(disparity, pair_like(9, 11)), atol=1e-12)


def test_unknown_and_impossible_disparities_give_nan_points():
    disparity = np.array([[np.nan, 0.0, -3.0, 100.0]], np.float32)
    assert np.isfinite(triangulate(disparity, pair_like(1, 4))).all(axis=-1).tolist() == [
        [False, False, False, True]
    ]


def test_rectified_triangulation_is_opencvs_from_both_projections():
    rng = np.random.default_rng(0)
    disparity = rng.uniform(90, 150, (12, 15)).astype(np.float32)
    pair = pair_like(12, 15)
    x, y = np.meshgrid(np.arange(15.0), np.arange(12.0))
    uv_left = np.stack([x.ravel(), y.ravel()], axis=-1)
    uv_right = np.stack([(x - disparity).ravel(), y.ravel()], axis=-1)
    points = cv2.triangulatePoints(*projections(pair), uv_left.T, uv_right.T)
    np.testing.assert_allclose(
        (points[:3] / points[3]).T, triangulate(disparity, pair).reshape(-1, 3), atol=1e-9
    )
