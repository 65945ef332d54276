import numpy as np
from scipy.interpolate import make_interp_spline

from breastscan.vision.refining.photometric import GreyLevels
from breastscan.vision.refining.spline_field import Region


def grey_levels() -> tuple[GreyLevels, np.ndarray, Region]:
    rng = np.random.default_rng(0)
    left, right = rng.integers(0, 255, (2, 21, 60)).astype(np.uint8)
    mask = np.zeros((21, 60), bool)
    mask[3:19, 24:50] = True
    region = Region.around(mask, 8)
    return GreyLevels.cut(left, right, region), right, region


def test_right_image_between_pixels_is_scipys_cubic_interpolation():
    """Inside the image, where the two ways of ending a spline at the border agree."""
    levels, right, region = grey_levels()
    disparity = np.random.default_rng(1).uniform(3, 9, levels.left.shape)
    value, _ = levels.right_at(disparity)
    for row, column, d, got in zip(
        levels.row.flat, levels.column.flat, disparity.flat, value.flat, strict=True
    ):
        spline = make_interp_spline(np.arange(60.0), right[region.top + row].astype(float), k=3)
        assert abs(got - spline(column - d)) < 0.05


def test_slope_is_the_derivative_of_the_interpolated_grey_level():
    levels, _, _ = grey_levels()
    disparity = np.random.default_rng(2).uniform(3, 9, levels.left.shape)
    step = 1e-5
    difference = levels.right_at(disparity - step)[0] - levels.right_at(disparity + step)[0]
    np.testing.assert_allclose(levels.right_at(disparity)[1], difference / (2 * step), atol=1e-3)


def test_pixels_whose_match_is_beyond_the_border_pull_nothing():
    levels, _, _ = grey_levels()
    assert (levels.right_at(np.full(levels.left.shape, 70.0))[1] == 0).all()


def test_region_is_cut_from_the_image_and_pasted_back():
    image = np.arange(21 * 60, dtype=float).reshape(21, 60)
    mask = np.zeros((21, 60), bool)
    mask[15:, 52:] = True
    region = Region.around(mask, 8)
    part = region.cut(image, np.nan)
    assert part.shape == (8, 8)
    assert np.isnan(part[6:]).all()
    np.testing.assert_array_equal(part[:6], image[15:, 52:])
    negative = region.pasted(-region.field.to_cells(part), image)
    np.testing.assert_array_equal(negative, np.where(mask, -image, image))
