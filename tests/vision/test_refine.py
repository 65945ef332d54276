"""Photometric refinement against ray-cast truth and synthetic pairs with known disparity."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from breastscan.cloud.segment import segment_breast
from breastscan.errors import ConfigError, PerceptionError
from breastscan.vision.refine import RefineConfig, RefinedDisparity, refine
from breastscan.vision.refining.photometric import FitConfig
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments.ray_cast_dome import DomeScene

SCENE = DomeScene()


@cache
def matched_dome() -> tuple[np.ndarray, np.ndarray]:
    """The matcher's disparity of the dome and the mask of the skin found in it."""
    pair = SCENE.pair()
    disparity = disparity_map(pair.left, pair.right, StereoConfig())
    return disparity, segment_breast(triangulate(disparity, pair)).mask


@cache
def refined_dome() -> RefinedDisparity:
    pair = SCENE.pair()
    return refine(pair.left, pair.right, *matched_dome())


def depth_rmse_mm(disparity: np.ndarray, where: np.ndarray) -> float:
    depth = SCENE.focal_px * SCENE.baseline / disparity
    return float(1e3 * np.sqrt(np.mean((depth - SCENE.points[..., 2])[where] ** 2)))


def from_axis() -> np.ndarray:
    return np.linalg.norm(SCENE.points[..., :2] - SCENE.sphere_centre[:2], axis=-1)


def textured_pair(
    disparity: np.ndarray, seed: int, noise: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """A right image of blurred noise and the left one that has exactly this disparity."""
    rng = np.random.default_rng(seed)
    height, width = disparity.shape
    scene = 128 + gaussian_filter(rng.normal(0, 90, disparity.shape), 1.5) * 1.5
    rows, columns = np.mgrid[:height, :width]
    left = map_coordinates(
        spline_filter(scene), [rows, columns - disparity], prefilter=False, mode="nearest"
    )
    return tuple(
        np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)
        for image in (left, scene)
    )


def tilted_plane(height: int = 120, width: int = 200) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width]
    return 40 + 0.03 * columns - 0.02 * rows


def rough(disparity: np.ndarray, seed: int = 5) -> np.ndarray:
    """The disparity as a matcher gives it: .15 px off, smoothly."""
    error = gaussian_filter(np.random.default_rng(seed).normal(0, 1, disparity.shape), 2.0)
    return (disparity + 0.15 * error / error.std()).astype(np.float32)


def inner(disparity: np.ndarray) -> np.ndarray:
    mask = np.zeros(disparity.shape, bool)
    mask[10:-10, 60:-10] = True
    return mask


def test_depth_on_the_dome_is_within_eight_hundredths_of_a_millimetre():
    """Grey-level noise of 1 at 540 mm, where a whole disparity pixel is 4.3 mm; up to 10 mm from
    the steep rim.
    """
    dome = matched_dome()[1] & (from_axis() < 0.065)
    assert depth_rmse_mm(refined_dome().disparity, dome) < 0.08
    assert depth_rmse_mm(matched_dome()[0], dome & np.isfinite(matched_dome()[0])) > 0.2


def test_rim_stays_covered_and_close_to_the_surface():
    """A slope of 72 degrees turns image error into depth error; distance to the surface is what
    counts there.
    """
    refined = refined_dome()
    skin = SCENE.on_dome & SCENE.seen_twice
    mask = matched_dome()[1]
    covered = mask & np.isfinite(refined.disparity)
    assert covered[skin].mean() > 0.97
    points = triangulate(refined.disparity, SCENE.pair())[covered]
    distance = np.linalg.norm(points - SCENE.sphere_centre, axis=-1) - SCENE.sphere_radius
    assert 1e3 * np.sqrt(np.mean(distance**2)) < 0.12


def test_everything_off_the_object_stays_as_the_matcher_left_it():
    matched, mask = matched_dome()
    refined = refined_dome()
    assert not (refined.applied & ~mask).any()
    np.testing.assert_array_equal(refined.disparity[~refined.applied], matched[~refined.applied])
    np.testing.assert_array_equal(np.isfinite(refined.sigma_px), refined.applied)


def test_errors_are_as_large_as_the_reported_deviation_says():
    truth = tilted_plane()
    ratios = []
    for seed in range(4):
        left, right = textured_pair(truth, seed)
        refined = refine(left, right, rough(truth), inner(truth))
        error = (refined.disparity - truth)[refined.applied] / refined.sigma_px[refined.applied]
        ratios.append(np.sqrt(np.mean(error**2)))
    assert 0.7 < np.mean(ratios) < 1.3


def test_noise_between_the_images_is_found():
    """Two images with noise of 2 grey levels each differ by sqrt(2) times that."""
    left, right = textured_pair(tilted_plane(), seed=7, noise=2.0)
    refined = refine(left, right, rough(tilted_plane()), inner(tilted_plane()))
    assert abs(refined.noise - 2 * np.sqrt(2)) < 0.5


def test_gain_and_bias_between_the_cameras_do_not_matter():
    truth = tilted_plane()
    left, right = textured_pair(truth, seed=8)
    darker = np.clip(0.8 * right.astype(float) + 12, 0, 255).astype(np.uint8)
    refined = refine(left, darker, rough(truth), inner(truth))
    assert np.sqrt(np.mean((refined.disparity - truth)[refined.applied] ** 2)) < 0.03


def test_depth_discontinuity_inside_the_mask_is_left_alone():
    """A step of 8 px, 34 mm at 540 mm: no pixel beside it moves, and pixels off it are refined
    as ever.
    """
    truth = tilted_plane()
    truth[:, 120:] += 8
    left, right = textured_pair(truth, seed=9)
    start = rough(truth)
    refined = refine(left, right, start, inner(truth))
    reach = RefineConfig().spacing_px
    beside = np.s_[10:-10, 120 - reach : 120 + reach]
    assert not refined.applied[beside].any()
    np.testing.assert_array_equal(refined.disparity[beside], start[beside])
    for side in (np.s_[20:-20, 70:100], np.s_[20:-20, 145:180]):
        assert refined.applied[side].all()
        assert np.sqrt(np.mean((refined.disparity - truth)[side] ** 2)) < 0.03


def test_holes_of_the_matcher_are_filled_from_the_images():
    truth = tilted_plane()
    left, right = textured_pair(truth, seed=10)
    start = rough(truth)
    start[50:58, 100:110] = np.nan
    refined = refine(left, right, start, inner(truth))
    assert refined.applied[50:58, 100:110].all()
    assert np.abs(refined.disparity - truth)[50:58, 100:110].max() < 0.1


def test_surface_without_texture_keeps_the_matchers_disparity():
    truth = tilted_plane()
    flat = np.full(truth.shape, 128, np.uint8)
    refined = refine(flat, flat, rough(truth), inner(truth))
    assert not refined.applied.any()
    np.testing.assert_array_equal(refined.disparity, rough(truth))


def test_mask_at_the_image_border_is_refined_up_to_it():
    truth = tilted_plane(117, 197)
    left, right = textured_pair(truth, seed=11)
    mask = np.zeros(truth.shape, bool)
    mask[:, 60:] = True
    refined = refine(left, right, rough(truth), mask)
    assert refined.applied[mask].mean() > 0.99
    assert np.sqrt(np.mean((refined.disparity - truth)[refined.applied] ** 2)) < 0.03


@pytest.mark.parametrize(
    "mask", [np.zeros((40, 60), bool), np.ones((40, 60), bool)], ids=["empty", "all unknown"]
)
def test_object_without_known_disparity_is_refused(mask):
    image = np.zeros((40, 60), np.uint8)
    with pytest.raises(PerceptionError, match="found none among the mask"):
        refine(image, image, np.full((40, 60), np.nan, np.float32), mask)


@pytest.mark.parametrize("wrong", [{"spacing_px": 1}, {"largest_sigma_px": 0.0}, {"jump_px": -1.0}])
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        RefineConfig(**wrong)


@pytest.mark.parametrize("wrong", [{"iterations": 0}, {"smoothing": 0.0}, {"robust_scale": -1.0}])
def test_fits_that_cannot_work_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        FitConfig(**wrong)
