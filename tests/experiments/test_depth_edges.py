"""The synthetic room's truth is one that its images obey, and the matcher keeps to its depth
edges.
"""

import numpy as np
from scipy.ndimage import map_coordinates

from breastscan.vision.stereo import StereoConfig, disparity_map
from experiments.bench_edges import filled_from_background
from experiments.depth_edges import edge_pair


def test_right_image_shows_at_x_minus_d_what_the_left_one_shows_at_x():
    pair = edge_pair(width=480, height=240, noise=0.0)
    rows, columns = np.mgrid[:240, :480]
    seen = map_coordinates(pair.right.astype(float), [rows, columns - pair.disparity], order=3)
    difference = np.abs(seen - pair.left)[pair.seen_twice]
    assert np.median(difference) < 1.0
    assert np.quantile(difference, 0.97) < 8.0


def test_fewer_than_one_matched_pixel_in_a_hundred_is_off_by_more_than_one():
    pair = edge_pair(width=480, height=240)
    disparity = disparity_map(pair.left, pair.right, StereoConfig())
    known = pair.seen_twice & np.isfinite(disparity)
    known[:, :192] = False
    assert np.mean(np.abs(disparity - pair.disparity)[known] > 1) < 0.01


def test_holes_take_the_disparity_of_the_surface_behind():
    nan = np.nan
    row = np.array([[nan, 5, nan, nan, 9, nan, 7, nan]], np.float32)
    np.testing.assert_array_equal(filled_from_background(row), [[5, 5, 5, 5, 9, 7, 7, 7]])
