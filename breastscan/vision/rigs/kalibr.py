"""Kalibr's camera chains: `cam0` and `cam1` with the place of the first in the second."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from breastscan.vision.rigs.found import FoundCamera, FoundRig, array, coefficients, size
from breastscan.vision.rigs.trees import Tree

TOOL = "Kalibr"
FISHEYE = {"radtan": False, "equidistant": True}
"""Whether a distortion is the fisheye's."""


def read(trees: Sequence[Tree]) -> FoundRig | None:
    """The rig of the first two cameras; None of another tool's file.

    Raises:
        ValueError: A camera is of a model that OpenCV does not know, or something is missing.
    """
    for tree in trees:
        first, second = tree.get("cam0"), tree.get("cam1")
        if isinstance(first, dict) and isinstance(second, dict) and "camera_model" in first:
            X_RL = array(second.get("T_cn_cnm1"), (4, 4), "cam1's T_cn_cnm1")
            return FoundRig(
                tool=TOOL,
                left=_camera(first, "cam0"),
                right=_camera(second, "cam1"),
                R_RL=X_RL[:3, :3],
                p_RL=X_RL[:3, 3],
                unit=1.0,
            )
    return None


def _camera(camera: dict[str, Any], name: str) -> FoundCamera:
    model, lens = camera.get("camera_model"), camera.get("distortion_model")
    if model != "pinhole" or lens not in FISHEYE:
        raise ValueError(
            f"{name} is {model}-{lens}, and pinhole-radtan or pinhole-equidistant are read: "
            "calibrate with one of these models"
        )
    fx, fy, cx, cy = array(camera.get("intrinsics"), (4,), f"{name}'s intrinsics").tolist()
    width, height = array(camera.get("resolution"), (2,), f"{name}'s resolution").tolist()
    return FoundCamera(
        K=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        distortion=coefficients(camera.get("distortion_coeffs"), f"{name}'s distortion_coeffs"),
        size=size(width, height, f"{name}'s resolution"),
        fisheye=FISHEYE[lens],
    )
