"""Rows that do not match: known shifts are found and undone, and a sound pair is left as it is."""

from functools import cache

import cv2
import numpy as np
import pytest

from breastscan.cloud.segment import segment_breast
from breastscan.vision.refine import RefinedDisparity, refine
from breastscan.vision.refining.row_shift import RowShift
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.ray_cast_dome import DomeScene

SCENE = DomeScene()


def moved(right: np.ndarray, offset: float, along_x: float, along_y: float) -> np.ndarray:
    """The right image as a camera sees it whose rows are off by so much: what was on row y lies
    on y + shift.
    """
    y, x = np.mgrid[: SCENE.height_px, : SCENE.width_px].astype(np.float32)
    shift = offset + along_x * (x - 200) + along_y * (y - 220)
    # where the shift rises along y, the inverse of y + shift(y) is wanted: one fixed-point step is
    # exact to 1e-5 px
    source = y - (offset + along_x * (x - 200) + along_y * (y - shift - 220))
    return cv2.remap(
        right, x, source.astype(np.float32), cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE
    )


@cache
def refined(offset: float, along_x: float, along_y: float) -> RefinedDisparity:
    pair = SCENE.pair()
    right = (
        pair.right
        if offset == along_x == along_y == 0
        else moved(pair.right, offset, along_x, along_y)
    )
    matched = disparity_map(pair.left, right, StereoConfig())
    return refine(pair.left, right, matched, segment_breast(triangulate(matched, pair)).mask)


def depth_rmse_mm(disparity: np.ndarray) -> float:
    from_axis = np.linalg.norm(SCENE.points[..., :2] - SCENE.sphere_centre[:2], axis=-1)
    dome = SCENE.on_dome & (from_axis < 0.065) & np.isfinite(disparity)
    depth = SCENE.focal_px * SCENE.baseline / disparity
    return float(1e3 * np.sqrt(np.mean((depth - SCENE.points[..., 2])[dome] ** 2)))


@pytest.mark.parametrize(
    ("offset", "along_x", "along_y"),
    [(0.24, 0.0, 0.0), (-0.6, 0.0, 0.0), (0.0, 9e-4, 0.0), (0.1, -5e-4, 8e-4)],
    ids=["pitch of .02 deg", "pitch of .05 deg", "roll of .05 deg", "all three"],
)
def test_known_shifts_are_found_to_a_fortieth_of_a_pixel(offset, along_x, along_y):
    found = refined(offset, along_x, along_y).row_shift
    y, x = np.mgrid[150:300:10, 130:270:10].astype(float)  # where the dome is in the right image
    expected = offset + along_x * (x - 200) + along_y * (y - 220)
    assert np.abs(found.at(x, y) - expected).max() < 0.025


@pytest.mark.parametrize(("offset", "along_x"), [(0.24, 0.0), (0.1, 9e-4), (-0.6, 0.0)])
def test_depth_is_as_exact_as_without_the_shift(offset, along_x):
    """The sound pair reaches .063 mm; rows left as they are would leave .20, .14 and .49 mm."""
    assert depth_rmse_mm(refined(offset, along_x, 0.0).disparity) < 0.07


def test_a_sound_pair_is_not_resampled():
    shift = refined(0.0, 0.0, 0.0).row_shift
    assert (shift.offset, shift.along_x, shift.along_y) == (0.0, 0.0, 0.0)
    right = SCENE.pair().right
    assert shift.undone(right, slice(0, 40)) is right


def test_surface_without_texture_gives_no_shift():
    flat = np.full((60, 90), 120, np.uint8)
    mask = np.zeros(flat.shape, bool)
    mask[10:50, 40:80] = True
    result = refine(flat, flat, np.full(flat.shape, 20, np.float32), mask)
    assert result.row_shift == RowShift()
