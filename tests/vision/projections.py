"""The projection matrices of a rectified pair."""

import numpy as np

from breastscan.vision.camera import RectifiedPair


def projections(pair: RectifiedPair) -> tuple[np.ndarray, np.ndarray]:
    """M^1 and M^2 of its two views [Zhang, Eqs. 8, 9]."""
    (cx, cy), f = pair.centre_px, pair.focal_px
    left = np.array([[f, 0, cx, 0], [0, f, cy, 0], [0, 0, 1, 0]])
    return left, left + np.outer([-f * pair.baseline, 0, 0], [0, 0, 0, 1])
