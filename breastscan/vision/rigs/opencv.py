"""OpenCV's stereo calibrations, and ours: matrices under one of the names that people give them, in
YAML, JSON, XML or `.npz`, in one file or in two (intrinsics and extrinsics).
"""

import re
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from breastscan.vision.rigs.found import FoundCamera, FoundRig, array, coefficients, size
from breastscan.vision.rigs.trees import Tree

TOOL, OURS = "OpenCV", "breastscan"
SIDES = (("left", "right"), ("1", "2"), ("l", "r"), ("0", "1"))
"""How the cameras are told apart."""
MATRICES = ("k", "m", "cameramatrix", "cm", "mtx", "intrinsics", "intrinsicmatrix", "intrinsic")
DISTORTIONS = (
    "d", "distcoeffs", "distcoefs", "distortion", "dist", "distortioncoefficients", "distcoef",
)  # fmt: skip
ROTATIONS = ("r", "rotation", "rotationmatrix", "rmat", "rvec")
TRANSLATIONS = ("t", "translation", "translationvector", "tvec")
SIZES = ("imagesize", "imgsize", "size", "imagewidthheight")
"""Letters and digits alone, in lower case."""


def read(trees: Sequence[Tree]) -> FoundRig | None:
    """The rig in the files; None where they do not name two camera matrices.

    Raises:
        ValueError: They do, and something else is missing or is no number.
    """
    names = {_plain(name): value for tree in trees for name, value in tree.items()}
    for left, right in SIDES:
        if _first(names, MATRICES, left) is not None and _first(names, MATRICES, right) is not None:
            R_RL, p_RL = _place(names)
            X_BL = names.get("xbl")
            return FoundRig(
                tool=OURS if "xrl" in names else TOOL,
                left=_camera(names, left),
                right=_camera(names, right),
                R_RL=R_RL,
                p_RL=p_RL,
                unit=1.0 if "xrl" in names else None,
                X_BL=None if X_BL is None else array(X_BL, (4, 4), "X_BL"),
            )
    return None


def _plain(name: str) -> str:
    return re.sub("[^a-z0-9]", "", name.lower())


def _first(names: Tree, known: Sequence[str], side: str = "") -> Any:
    """The first value under a known name, for a side before it or behind it."""
    found = (names.get(key) for name in known for key in (name + side, side + name))
    return next((value for value in found if value is not None), None)


def _camera(names: Tree, side: str) -> FoundCamera:
    distortion = _first(names, DISTORTIONS, side)
    if distortion is None:
        raise ValueError(f"distortion_{side}, or another name for it, is missing")
    return FoundCamera(
        K=array(_first(names, MATRICES, side), (3, 3), f"camera_matrix_{side}"),
        distortion=coefficients(distortion, f"distortion_{side}"),
        size=_size(names, side),
    )


def _size(names: Tree, side: str) -> tuple[int, int] | None:
    for pair in (("imagewidth" + side, "imageheight" + side), ("imagewidth", "imageheight")):
        if pair[0] in names or pair[1] in names:
            width, height = (names.get(name) for name in pair)
            return size(width, height, f"image_width_{side} or image_height_{side}")
    for name in SIZES:
        if name in names:
            width, height = array(names[name], (2,), name).tolist()
            return size(width, height, name)
    return None


def _place(names: Tree) -> tuple[np.ndarray, np.ndarray]:
    """The left camera in the right one."""
    if "xrl" in names:
        X_RL = array(names["xrl"], (4, 4), "X_RL")
        return X_RL[:3, :3], X_RL[:3, 3]
    R, T = _first(names, ROTATIONS), _first(names, TRANSLATIONS)
    if R is None or T is None:
        raise ValueError("X_RL, or R and T, are missing: give the file of the extrinsics too")
    p_RL = array(T, (3,), "T")
    if np.size(R) == 3:
        return cv2.Rodrigues(array(R, (3,), "R"))[0], p_RL
    return array(R, (3, 3), "R"), p_RL
