"""A rig as ROS knows it: one `camera_info` per camera, as `camera_info_manager` loads them or as
`rostopic echo` and `ros2 topic echo` print them.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from breastscan.vision.rigs.found import FoundCamera, FoundRig, array, coefficients, size
from breastscan.vision.rigs.trees import Tree

TOOL = "ROS"
FISHEYE = {"plumb_bob": False, "rational_polynomial": False, "equidistant": True}
"""Whether a distortion is the fisheye's."""
NAMES = {
    "k": ("camera_matrix", "K", "k"),
    "d": ("distortion_coefficients", "D", "d"),
    "r": ("rectification_matrix", "R", "r"),
    "p": ("projection_matrix", "P", "p"),
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
}
"""In a file of the manager, in a message of ROS 1, in one of ROS 2."""


def read(trees: Sequence[Tree]) -> FoundRig | None:
    """The rig in two files; None of another tool's.

    Raises:
        ValueError: There is one camera only, or they are no stereo pair.
    """
    infos = [tree for tree in trees if "distortion_model" in tree and _value(tree, "p") is not None]
    if not infos:
        return None
    if len(infos) != 2:
        raise ValueError(
            f"{len(infos)} camera_info given, and a rig takes two: give the left and the right "
            "camera's file"
        )
    # the right one's projection holds minus focal length times baseline
    shifts = [array(_value(info, "p"), (3, 4), "projection_matrix")[0, 3] for info in infos]
    left, right = (infos[k] for k in np.argsort(np.abs(shifts), kind="stable"))
    P = array(_value(right, "p"), (3, 4), "projection_matrix")
    if P[0, 3] == 0.0 or P[0, 0] == 0.0:
        raise ValueError(
            "both projection matrices have no baseline: these are two single cameras, so "
            "calibrate them as a pair"
        )
    R_left, R_right = (
        array(_value(info, "r"), (3, 3), "rectification_matrix") for info in (left, right)
    )
    shift = np.array([P[0, 3] / P[0, 0], P[1, 3] / P[1, 1], 0.0])
    return FoundRig(
        tool=TOOL,
        left=_camera(left),
        right=_camera(right),
        R_RL=R_right.T @ R_left,
        p_RL=R_right.T @ shift,
        unit=1.0,
    )


def _value(info: Tree, what: str) -> Any:
    """A value under one of its names; a matrix is a list, or a list in a tree."""
    value = next((info[name] for name in NAMES[what] if name in info), None)
    return value.get("data") if isinstance(value, dict) else value


def _camera(info: Tree) -> FoundCamera:
    model = info["distortion_model"]
    if model not in FISHEYE:
        raise ValueError(f"distortion_model is {model!r}, expected one of {', '.join(FISHEYE)}")
    return FoundCamera(
        K=array(_value(info, "k"), (3, 3), "camera_matrix"),
        distortion=coefficients(_value(info, "d"), "distortion_coefficients"),
        size=size(_value(info, "width"), _value(info, "height"), "image_width or image_height"),
        fisheye=FISHEYE[model],
    )
