"""From matched pixels to points in space [Zhang, Eqs. 8-11]."""

import numpy as np
from jaxtyping import Float, Float32

from breastscan.vision.camera import RectifiedPair


def triangulate(disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair) -> Float[np.ndarray, "h w 3"]:
    """Surface point in L that each left pixel sees [m]; NaN where the disparity is unknown or not positive.

    For a rectified pair the pseudo-inverse of [Zhang, Eq. 11] is depth = focal length x baseline / disparity.
    """
    height, width = disparity.shape
    (cx, cy), f = pair.centre_px, pair.focal_px
    known = np.where(disparity > 0, disparity, np.nan).astype(float)
    x, y = np.meshgrid(np.arange(width) - cx, np.arange(height) - cy)
    rays_V = np.stack([x, y, np.full_like(x, f)], axis=-1)
    p_V = rays_V * (pair.baseline / known)[..., None]
    return p_V @ pair.R_LV.T


def depth_map(disparity: Float32[np.ndarray, "h w"], pair: RectifiedPair) -> Float32[np.ndarray, "h w"]:
    """Depth of each left pixel along the axis of the rectified left view [m]; NaN where `triangulate` has none."""
    known = np.where(disparity > 0, disparity, np.nan)
    return (pair.focal_px * pair.baseline / known).astype(np.float32)


def triangulate_points(
    P1: Float[np.ndarray, "3 4"],
    P2: Float[np.ndarray, "3 4"],
    uv1: Float[np.ndarray, "n 2"],
    uv2: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "n 3"]:
    """Points seen at `uv1` [px] by the camera with projection `P1` and at `uv2` by that with `P2` [Zhang, Eqs. 8-11].

    The frame and unit are those that the projections take. Four equations, three unknowns: least squares.
    """
    rows = [
        uv[:, i, None] * P[2] - P[i]  # (u m_3 - m_1) (X, 1) = 0, and likewise for v [Zhang, Eq. 10]
        for P, uv in ((P1, uv1), (P2, uv2))
        for i in range(2)
    ]
    equations = np.stack(rows, axis=1)
    A, b = equations[..., :3], -equations[..., 3]
    return (np.linalg.pinv(A) @ b[..., None])[..., 0]
