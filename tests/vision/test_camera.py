"""Rectification and rig files, against OpenCV's point functions and projection by hand."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError, PerceptionError
from breastscan.geometry import se3
from breastscan.vision.camera import Intrinsics, StereoRig
from tests.vision.projections import projections


def toed_in_rig() -> StereoRig:
    """Two distorted cameras 99 mm apart that look towards each other by 4 degrees."""
    R_RL = Rotation.from_euler("xyz", [0.8, -4.0, 0.4], degrees=True).as_matrix()
    left = Intrinsics(
        K=np.array([[341.0, 0, 163.0], [0, 342.0, 118.5], [0, 0, 1]]),
        distortion=np.array([-0.07, 0.14, 5e-4, 8e-4, -0.08]),
        width=320,
        height=240,
    )
    right = dataclasses.replace(left, K=np.array([[343.0, 0, 160.2], [0, 343.5, 121.0], [0, 0, 1]]))
    return StereoRig(
        left=left, right=right, X_RL=se3.pose(R_RL, np.array([-0.0989, 0.0041, -0.0003]))
    )


def points_in_view() -> np.ndarray:
    return np.random.default_rng(0).uniform([-0.05, -0.07, 0.45], [0.12, 0.07, 0.6], (40, 3))


def pixels(camera: Intrinsics, points: np.ndarray) -> np.ndarray:
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0][:, 0]


def image_of_dots(camera: Intrinsics, points: np.ndarray) -> np.ndarray:
    """Gaussian dots, 2 px wide, where the distorted camera sees the points."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    image = np.zeros(rows.shape)
    for x, y in pixels(camera, points):
        image += 200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 2.0**2))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def dot_centre(image: np.ndarray, near: np.ndarray) -> np.ndarray:
    x, y = np.rint(near).astype(int)
    window = image[y - 7 : y + 8, x - 7 : x + 8].astype(float)
    rows, columns = np.mgrid[y - 7 : y + 8, x - 7 : x + 8]
    return np.array([(window * columns).sum(), (window * rows).sum()]) / window.sum()


def project(P: np.ndarray, points: np.ndarray) -> np.ndarray:
    homogeneous = points @ P[:, :3].T + P[:, 3]
    return homogeneous[:, :2] / homogeneous[:, 2:]


def test_rectified_dots_lie_where_the_projection_matrices_say():
    """Distorted, toed-in images of one dot at a time land within .05 px, on the same row of both
    views.
    """
    rig = toed_in_rig()
    for point in points_in_view()[:8]:
        images = [
            image_of_dots(camera, se3.transform(X, point[None]))
            for camera, X in ((rig.left, np.eye(4)), (rig.right, rig.X_RL))
        ]
        pair = rig.rectify(*images)
        p_V = (pair.R_LV.T @ point)[None]
        left_px, right_px = (project(P, p_V)[0] for P in projections(pair))
        assert abs(left_px[1] - right_px[1]) < 1e-9
        np.testing.assert_allclose(dot_centre(pair.left, left_px), left_px, atol=0.05)
        np.testing.assert_allclose(dot_centre(pair.right, right_px), right_px, atol=0.05)


def test_disparity_of_the_rectified_views_gives_depth():
    rig = toed_in_rig()
    image = np.zeros((240, 320), np.uint8)
    pair = rig.rectify(image, image)
    p_V = points_in_view() @ pair.R_LV
    left_px, right_px = (project(P, p_V) for P in projections(pair))
    np.testing.assert_allclose(
        pair.focal_px * pair.baseline / (left_px - right_px)[:, 0], p_V[:, 2]
    )
    points = cv2.triangulatePoints(*projections(pair), left_px.T, right_px.T)
    np.testing.assert_allclose((points[:3] / points[3]).T, p_V, atol=1e-9)
    assert abs(pair.baseline - np.linalg.norm(rig.X_RL[:3, 3])) < 1e-12


def test_saved_rig_loads_unchanged(tmp_path):
    rig = dataclasses.replace(
        toed_in_rig(), X_BL=se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.4, 0.0, 0.6]))
    )
    rig.save(tmp_path / "rig.yaml")
    loaded = StereoRig.load(tmp_path / "rig.yaml")
    for before, after in ((rig.left, loaded.left), (rig.right, loaded.right)):
        np.testing.assert_array_equal(before.K, after.K)
        np.testing.assert_array_equal(before.distortion, after.distortion)
        assert (before.width, before.height) == (after.width, after.height)
    np.testing.assert_allclose(loaded.X_RL, rig.X_RL, atol=1e-12)
    assert loaded.X_BL is not None
    np.testing.assert_allclose(loaded.X_BL, rig.X_BL, atol=1e-12)


def test_rig_before_hand_eye_calibration_has_no_place_in_the_base(tmp_path):
    toed_in_rig().save(tmp_path / "rig.yaml")
    assert StereoRig.load(tmp_path / "rig.yaml").X_BL is None


def test_images_of_another_size_are_refused():
    with pytest.raises(PerceptionError, match="the right image is 320x239 px"):
        toed_in_rig().rectify(np.zeros((240, 320), np.uint8), np.zeros((239, 320), np.uint8))


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (
            lambda text: text.replace("camera_matrix_left", "camera_matrix_top"),
            "camera_matrix_left",
        ),
        (
            lambda text: text.replace("image_width_right: 320", "image_width_right: -1"),
            "image_width_right",
        ),
        (
            lambda text: text.replace("341.", ".Nan"),
            "camera_matrix_left holds a number that is not finite",
        ),
        (lambda text: text[: len(text) // 2], "is missing|cannot parse|cannot open"),
        (lambda text: "not a rig at all", "not a rig file"),
    ],
)
def test_damaged_rig_files_are_refused_with_what_is_wrong(tmp_path, damage, reason):
    path = tmp_path / "rig.yaml"
    toed_in_rig().save(path)
    path.write_text(damage(path.read_text()))
    with pytest.raises(CalibrationError, match=reason):
        StereoRig.load(path)


def test_rig_with_a_mirrored_rotation_is_refused(tmp_path):
    mirrored = toed_in_rig().X_RL @ np.diag([1.0, 1.0, -1.0, 1.0])
    dataclasses.replace(toed_in_rig(), X_RL=mirrored).save(tmp_path / "rig.yaml")
    with pytest.raises(CalibrationError, match="the rotation of X_RL"):
        StereoRig.load(tmp_path / "rig.yaml")


def test_missing_rig_file_says_how_to_get_one(tmp_path):
    with pytest.raises(CalibrationError, match="give one with --rig"):
        StereoRig.load(tmp_path / "none.yaml")
