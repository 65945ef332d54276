"""A rig for other tools: ROS's `camera_info`, and OpenCV's usual names."""

from pathlib import Path

import cv2
import numpy as np

from breastscan.vision.camera import Intrinsics, StereoRig

PLUMB_BOB = 5
"""Coefficients of ROS's plain lens; more are its rational one's."""


def write_opencv(path: Path, rig: StereoRig) -> None:
    """Write K1, D1, K2, D2, R, T [m] and the pictures' size as OpenCV's FileStorage."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", rig.left.width)
    storage.write("image_height", rig.left.height)
    for number, camera in ((1, rig.left), (2, rig.right)):
        storage.write(f"K{number}", camera.K)
        storage.write(f"D{number}", camera.distortion.reshape(1, -1))
    storage.write("R", rig.X_RL[:3, :3].copy())
    storage.write("T", rig.X_RL[:3, 3:].copy())
    storage.release()


def write_camera_info(folder: Path, rig: StereoRig) -> None:
    """Write `left_camera_info.yaml` and `right_camera_info.yaml`, lengths in metres.

    The projection matrices are those of the rectified pair: the right one holds minus focal length
    times baseline.
    """
    sides = (("left", rig.left), ("right", rig.right))
    for (side, camera), (R, P) in zip(sides, rig.rectified_views, strict=True):
        (folder / f"{side}_camera_info.yaml").write_text(
            _camera_info(side, camera, R, P), encoding="utf-8"
        )


def _camera_info(side: str, camera: Intrinsics, R: np.ndarray, P: np.ndarray) -> str:
    lens = "plumb_bob" if len(camera.distortion) <= PLUMB_BOB else "rational_polynomial"
    return (
        f"image_width: {camera.width}\n"
        f"image_height: {camera.height}\n"
        f"camera_name: {side}\n"
        f"distortion_model: {lens}\n"
        + _matrix("camera_matrix", camera.K)
        + _matrix("distortion_coefficients", camera.distortion[None])
        + _matrix("rectification_matrix", R)
        + _matrix("projection_matrix", P)
    )


def _matrix(name: str, value: np.ndarray) -> str:
    numbers = ", ".join(repr(float(entry)) for entry in value.ravel())
    return f"{name}:\n  rows: {value.shape[0]}\n  cols: {value.shape[1]}\n  data: [{numbers}]\n"
