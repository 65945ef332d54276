"""From matched pixels to points in space [Zhang, Eqs. 8-11]."""

import numpy as np
from jaxtyping import Float, Float32

from breastscan.geometry.compiled import kernel
from breastscan.vision.camera import RectifiedPair


def triangulate(
    disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair
) -> Float[np.ndarray, "h w 3"]:
    """Surface point in L that each left pixel sees [m]; NaN where the disparity is unknown or not
    positive.

    For a rectified pair the pseudo-inverse of [Zhang, Eq. 11] is depth = focal length x baseline /
    disparity.
    """
    p_L = np.empty((*disparity.shape, 3))
    _triangulate(disparity, pair.focal_px, pair.centre_px, pair.baseline, pair.R_LV, p_L)
    return p_L


@kernel
def _triangulate(disparity, focal_px, centre_px, baseline, R_LV, p_L):
    """One pass over the image: its temporaries would cost ten times as much."""
    for row in range(disparity.shape[0]):
        for column in range(disparity.shape[1]):
            p_L[row, column] = np.nan
            if disparity[row, column] > 0:
                # metres at one pixel of the sensor
                scale = baseline / disparity[row, column]
                x = (column - centre_px[0]) * scale
                y = (row - centre_px[1]) * scale
                z = focal_px * scale
                for k in range(3):
                    p_L[row, column, k] = R_LV[k, 0] * x + R_LV[k, 1] * y + R_LV[k, 2] * z


def depth_map(
    disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair
) -> Float32[np.ndarray, "h w"]:
    """Depth of each left pixel along the axis of the rectified left view [m]; NaN where
    `triangulate` has none.
    """
    known = np.where(disparity > 0, disparity, np.nan)
    return (pair.focal_px * pair.baseline / known).astype(np.float32)
