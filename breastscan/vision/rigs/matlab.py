"""MATLAB's `stereoParameters`, as `toStruct` gives them, in a `.mat` file or in JSON.

MATLAB counts pixels from 1, sizes in rows and columns, and in the older fields writes matrices for
row vectors: transposed.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from breastscan.vision.rigs.found import (
    METRES,
    FoundCamera,
    FoundRig,
    array,
    coefficients,
    size,
)
from breastscan.vision.rigs.trees import Tree

TOOL = "MATLAB"
UNITS = {
    **METRES, "millimeters": METRES["mm"], "centimeters": METRES["cm"], "meters": METRES["m"],
    "inches": METRES["in"], "ft": 0.3048,
}  # fmt: skip
"""Of a pattern's squares [m]."""
HOW = "in MATLAB, s = toStruct(stereoParams); save('rig.mat', 's', '-v7') writes one that is"


def read(trees: Sequence[Tree]) -> FoundRig | None:
    """The rig; None of another tool's file.

    Raises:
        ValueError: It is an object of MATLAB's own, which nothing else reads, or something is
            missing.
    """
    for tree in trees:
        structs = [
            one
            for one in (tree, *tree.values())
            if isinstance(one, dict) and "CameraParameters1" in one
        ]
        if structs:
            return _rig(structs[0])
        if "__header__" in tree:
            raise ValueError(f"it holds no struct of stereoParameters: {HOW}")
    return None


def _rig(struct: Tree) -> FoundRig:
    cameras = [_dict(struct.get(f"CameraParameters{k}"), f"CameraParameters{k}") for k in (1, 2)]
    R_RL, p_RL = _place(struct)
    told = str(cameras[0].get("WorldUnits", "mm")).lower()
    if told not in UNITS:
        raise ValueError(f"WorldUnits is {told!r}, expected one of {', '.join(UNITS)}")
    left, right = (_camera(camera, f"CameraParameters{k}") for k, camera in enumerate(cameras, 1))
    return FoundRig(tool=TOOL, left=left, right=right, R_RL=R_RL, p_RL=p_RL, unit=UNITS[told])


def _dict(value: Any, name: str) -> Tree:
    if not isinstance(value, dict):
        raise ValueError(f"{name} is no struct: {HOW}")
    return value


def _place(struct: Tree) -> tuple[np.ndarray, np.ndarray]:
    pose = struct.get("PoseCamera2")
    if isinstance(pose, dict):
        if "A" in pose:
            X_RL = array(pose["A"], (4, 4), "PoseCamera2's A")
            return X_RL[:3, :3], X_RL[:3, 3]
        return (
            array(pose.get("R"), (3, 3), "PoseCamera2's R"),
            array(pose.get("Translation"), (3,), "PoseCamera2's Translation"),
        )
    transposed = array(struct.get("RotationOfCamera2"), (3, 3), "RotationOfCamera2")
    return transposed.T, array(struct.get("TranslationOfCamera2"), (3,), "TranslationOfCamera2")


def _camera(camera: Tree, name: str) -> FoundCamera:
    radial = array(camera.get("RadialDistortion"), None, f"{name}'s RadialDistortion")
    tangential = array(
        camera.get("TangentialDistortion", [0.0, 0.0]), (2,), f"{name}'s TangentialDistortion"
    )
    radial = np.pad(radial, (0, max(3 - len(radial), 0)))
    measured = camera.get("ImageSize")
    found = None
    if measured is not None and np.size(measured) == 2:
        height, width = array(measured, (2,), f"{name}'s ImageSize").tolist()
        found = size(width, height, f"{name}'s ImageSize")
    return FoundCamera(
        K=_matrix(camera, name),
        distortion=coefficients([*radial[:2], *tangential, *radial[2:]], name),
        size=found,
    )


def _matrix(camera: Tree, name: str) -> np.ndarray:
    """K, with pixels that are counted from 0."""
    if "K" in camera:
        K = array(camera["K"], (3, 3), f"{name}'s K")
    elif "IntrinsicMatrix" in camera:
        K = array(camera["IntrinsicMatrix"], (3, 3), f"{name}'s IntrinsicMatrix").T
    else:
        fx, fy = array(camera.get("FocalLength"), (2,), f"{name}'s FocalLength").tolist()
        cx, cy = array(camera.get("PrincipalPoint"), (2,), f"{name}'s PrincipalPoint").tolist()
        K = np.array([[fx, float(camera.get("Skew", 0.0)), cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return K - np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
