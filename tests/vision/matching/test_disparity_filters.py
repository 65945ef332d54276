"""Speckles and outliers, held to OpenCV's speckle filter and to the median written out."""

import cv2
import numpy as np
import pytest

from breastscan.vision.matching.disparity_filters import (
    UNKNOWN,
    filtered,
    mean_of_like,
    median_of_known,
    remove_speckles,
)


def patchy(seed: int, shape: tuple[int, int] = (90, 130)) -> np.ndarray:
    """Whole-number disparities in smooth patches of all sizes, a fifth unknown."""
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(
        rng.integers(1, 9, (30, 44)).astype(np.uint16), shape[::-1], interpolation=cv2.INTER_NEAREST
    )
    fixed = 40 * coarse + rng.integers(0, 8, shape).astype(np.uint16)
    fixed[rng.random(shape) < 0.2] = UNKNOWN
    return fixed


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("step", "smallest"), [(8, 1), (8, 5), (8, 40), (40, 100), (400, 10_000)])
def test_the_same_patches_go_as_in_opencv(seed, step, smallest):
    fixed = patchy(seed)
    expected = fixed.astype(np.int16)
    cv2.filterSpeckles(expected, int(UNKNOWN), smallest - 1, step)
    remove_speckles(fixed, step, smallest)
    np.testing.assert_array_equal(fixed, expected)


def test_a_patch_that_joins_late_counts_as_one():
    """Two arms of a U meet only in their last row."""
    fixed = np.zeros((20, 9), np.uint16)
    fixed[:, 1] = fixed[:, 7] = fixed[-1, 1:8] = 500
    remove_speckles(fixed, 10, 45)
    assert (fixed > 0).sum() == 45
    remove_speckles(fixed, 10, 46)
    assert (fixed > 0).sum() == 0


@pytest.mark.parametrize("size", [3, 5])
def test_median_uses_only_known_neighbours_and_keeps_unknown_pixels(size):
    fixed = np.random.default_rng(3).integers(1, 60_000, (30, 40)).astype(np.uint16)
    fixed[np.random.default_rng(4).random(fixed.shape) < 0.2] = UNKNOWN
    median = median_of_known(fixed, size)
    continued = np.pad(fixed, size // 2, mode="edge")
    for y, x in np.ndindex(fixed.shape):
        known = np.sort(continued[y : y + size, x : x + size].ravel())
        known = known[known != UNKNOWN]
        expected = UNKNOWN if fixed[y, x] == UNKNOWN else known[(known.size - 1) // 2]
        assert median[y, x] == expected


@pytest.mark.parametrize("size", [1, 3, 5])
@pytest.mark.parametrize("step", [3, 256])
def test_mean_is_taken_over_opposite_neighbours_within_the_step(size, step):
    fixed = patchy(7, (40, 70))
    difference_sum, count = mean_of_like(fixed, step, size)
    half = size // 2
    bordered = np.pad(fixed.astype(int), half)
    for y, x in np.argwhere(fixed != UNKNOWN):
        window = bordered[y : y + size, x : x + size].ravel()
        difference = window - int(fixed[y, x])
        like = (window != UNKNOWN) & (np.abs(difference) <= step)
        like &= like[::-1]
        assert (difference_sum[y, x], count[y, x]) == (difference[like].sum(), like.sum())


def test_mean_of_a_slope_is_the_slope_even_beside_an_edge():
    disparity = np.tile(0.25 * np.arange(60, dtype=np.float32) + 10, (20, 1))
    disparity[:, 40:] += 9
    passed = filtered(disparity, speckle_px=0, median_px=1, mean_px=5)
    np.testing.assert_allclose(passed, disparity, atol=1e-5)


def test_small_disparities_are_not_mixed_with_unknown_pixels():
    """Half a pixel, with holes: unknown is no small number."""
    disparity = np.full((20, 40), 0.5, np.float32)
    disparity[::3, ::2] = np.nan
    passed = filtered(disparity, speckle_px=0, median_px=1, mean_px=5)
    np.testing.assert_allclose(passed[np.isfinite(disparity)], 0.5, atol=1 / 512)


@pytest.mark.parametrize("largest", [30.0, 255.0, 900.0, 5000.0])
def test_disparities_pass_the_filters_to_a_fine_fraction_of_a_pixel(largest):
    disparity = np.linspace(0, largest, 4000, dtype=np.float32).reshape(40, 100)
    disparity[::7, ::5] = np.nan
    passed = filtered(disparity, speckle_px=1, median_px=1, mean_px=1)
    np.testing.assert_array_equal(np.isnan(passed), np.isnan(disparity))
    assert np.nanmax(np.abs(passed - disparity)) <= 0.5 / min(256, int(65023 / largest)) + 1e-3


def test_nothing_known_stays_unknown():
    nothing = np.full((12, 20), np.nan, np.float32)
    assert np.isnan(filtered(nothing, speckle_px=100, median_px=5, mean_px=5)).all()
