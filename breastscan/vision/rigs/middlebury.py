"""Middlebury's `calib.txt`: a rectified pair, lengths in millimetres."""

from collections.abc import Sequence

import numpy as np

from breastscan.vision.rigs.found import METRES, FoundCamera, FoundRig, array, size
from breastscan.vision.rigs.trees import Tree

TOOL = "Middlebury"


def read(trees: Sequence[Tree]) -> FoundRig | None:
    """The rig; None of another tool's file.

    Raises:
        ValueError: Something is missing.
    """
    for tree in trees:
        if {"cam0", "cam1", "baseline"} <= set(tree) and not isinstance(tree["cam0"], dict):
            measured = size(tree.get("width"), tree.get("height"), "width or height")
            left, right = (
                FoundCamera(
                    K=array(tree[name], (3, 3), name), distortion=np.zeros(5), size=measured
                )
                for name in ("cam0", "cam1")
            )
            baseline = array(tree["baseline"], (1,), "baseline")[0]
            return FoundRig(
                tool=TOOL,
                left=left,
                right=right,
                R_RL=np.eye(3),
                p_RL=np.array([-baseline, 0.0, 0.0]),
                unit=METRES["mm"],
            )
    return None
