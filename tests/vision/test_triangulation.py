"""Triangulation against projection, its inverse, and against OpenCV's."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.vision.camera import RectifiedPair
from breastscan.vision.triangulation import triangulate, triangulate_points
from experiments.ray_cast_dome import DomeScene


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


def project(P: np.ndarray, points: np.ndarray) -> np.ndarray:
    homogeneous = points @ P[:, :3].T + P[:, 3]
    return homogeneous[:, :2] / homogeneous[:, 2:]


def test_true_disparity_gives_the_true_dome_within_a_micrometre():
    scene = DomeScene(width_px=200, height_px=120)
    points = triangulate(scene.disparity.astype(np.float32), scene.pair(noise=0.0))
    assert np.abs(points - scene.points).max() < 1e-6


def test_points_come_out_in_the_unrectified_left_camera():
    """A view turned by `R_LV` about the optical centre shows the same points in turned coordinates."""
    R_LV = Rotation.from_euler("xyz", [2.0, -4.0, 1.0], degrees=True).as_matrix()
    disparity = np.full((9, 11), 120.0, np.float32)
    turned = triangulate(disparity, pair_like(9, 11, R_LV))
    np.testing.assert_allclose(turned @ R_LV, triangulate(disparity, pair_like(9, 11)), atol=1e-12)


def test_unknown_and_impossible_disparities_give_nan_points():
    disparity = np.array([[np.nan, 0.0, -3.0, 100.0]], np.float32)
    assert np.isfinite(triangulate(disparity, pair_like(1, 4))).all(axis=-1).tolist() == [[False, False, False, True]]


def test_rectified_triangulation_is_the_pseudo_inverse_of_both_projections():
    rng = np.random.default_rng(0)
    disparity = rng.uniform(90, 150, (12, 15)).astype(np.float32)
    pair = pair_like(12, 15)
    x, y = np.meshgrid(np.arange(15.0), np.arange(12.0))
    uv_left = np.stack([x.ravel(), y.ravel()], axis=-1)
    uv_right = np.stack([(x - disparity).ravel(), y.ravel()], axis=-1)
    general = triangulate_points(pair.P_left, pair.P_right, uv_left, uv_right)
    np.testing.assert_allclose(general, triangulate(disparity, pair).reshape(-1, 3), atol=1e-9)


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_general_triangulation_agrees_with_opencv_and_with_the_points_themselves(noise_px):
    """OpenCV weights the same equations otherwise, so that with pixel noise the two agree only to a fraction of it."""
    rng = np.random.default_rng(1)
    K = np.array([[681.7, 0, 646.4], [0, 682.3, 514.3], [0, 0, 1]])
    R = Rotation.from_euler("xyz", [0.9, -4.2, 0.3], degrees=True).as_matrix()
    P1 = K @ np.eye(3, 4)
    P2 = K @ np.column_stack([R, [-0.0989, 0.0041, -0.0003]])
    points = rng.uniform([-0.1, -0.1, 0.45], [0.1, 0.1, 0.65], (50, 3))
    uv1, uv2 = (project(P, points) + noise_px * rng.standard_normal((50, 2)) for P in (P1, P2))
    found = triangulate_points(P1, P2, uv1, uv2)
    oracle = cv2.triangulatePoints(P1, P2, uv1.T, uv2.T)
    np.testing.assert_allclose(found, (oracle[:3] / oracle[3]).T, atol=1e-9 + 1e-4 * noise_px)
    error_mm = 1e3 * np.abs(found - points).max()
    assert error_mm < 1e-6 + 20 * noise_px
