"""OpenCV's semi-global matcher, set as its documentation advises: the peer that benchmarks
compare with.
"""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

BLOCK = 5
"""Side of the matching block [px]; OpenCV's documentation derives both penalties from it."""
SUBPIXELS = 16
"""OpenCV's disparities are whole sixteenths of a pixel."""
UNIQUENESS_PERCENT = 10
SPECKLE_PX = 100
SPECKLE_STEP_PX = 2
"""How OpenCV's own sample has its matcher reject what is ambiguous."""


def opencv_matcher(min_disparity: int, num_disparities: int, mode: int) -> cv2.StereoSGBM:
    """A matcher that keeps its memory between pairs."""
    return cv2.StereoSGBM.create(
        minDisparity=min_disparity,
        numDisparities=num_disparities,
        blockSize=BLOCK,
        P1=8 * BLOCK**2,
        P2=32 * BLOCK**2,
        disp12MaxDiff=1,
        mode=mode,
    )


def opencv_disparity(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    min_disparity: int,
    num_disparities: int,
) -> Float32[np.ndarray, "h w"]:
    """Disparity of its eight-path mode, ambiguous matches rejected [px], NaN where unknown."""
    matcher = opencv_matcher(min_disparity, num_disparities, cv2.StereoSGBM_MODE_HH)
    matcher.setUniquenessRatio(UNIQUENESS_PERCENT)
    matcher.setSpeckleWindowSize(SPECKLE_PX)
    matcher.setSpeckleRange(SPECKLE_STEP_PX)
    matched = matcher.compute(left, right) / SUBPIXELS
    return np.where(matched >= min_disparity, matched, np.nan).astype(np.float32)
