"""From matched pixels to points in space [Zhang, Eqs. 8-11]."""

import numpy as np
from jaxtyping import Float, Float32

from breastscan.vision.camera import RectifiedPair


def triangulate(
    disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair
) -> Float[np.ndarray, "h w 3"]:
    """Surface point in L that each left pixel sees [m]; NaN where the disparity is unknown or not
    positive.

    For a rectified pair the pseudo-inverse of [Zhang, Eq. 11] is depth = focal length x baseline /
    disparity.
    """
    height, width = disparity.shape
    (cx, cy), f = pair.centre_px, pair.focal_px
    known = np.where(disparity > 0, disparity, np.nan).astype(float)
    x, y = np.meshgrid(np.arange(width) - cx, np.arange(height) - cy)
    rays_V = np.stack([x, y, np.full_like(x, f)], axis=-1)
    p_V = rays_V * (pair.baseline / known)[..., None]
    return p_V @ pair.R_LV.T


def depth_map(
    disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair
) -> Float32[np.ndarray, "h w"]:
    """Depth of each left pixel along the axis of the rectified left view [m]; NaN where
    `triangulate` has none.
    """
    known = np.where(disparity > 0, disparity, np.nan)
    return (pair.focal_px * pair.baseline / known).astype(np.float32)
