"""The matcher is held, bit for bit, to the paper's equations written out in plain NumPy."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from breastscan.errors import ConfigError, PerceptionError
from breastscan.vision.matching.census import census
from breastscan.vision.stereo import StereoConfig, disparity_map, disparity_range
from experiments.depth_edges import edge_pair
from experiments.ray_cast_dome import DomeScene

HALF_WIDTH, HALF_HEIGHT = 4, 3
COLUMNS_AND_ROWS = [(0, 1), (0, -1), (1, 0), (-1, 0)]
DIAGONALS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
SMALL = StereoConfig(min_disparity=3, num_disparities=32, speckle_px=0, median_px=1, mean_px=1)


def pair_with_steps(height: int, width: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A textured pair whose disparity is 10 px on the left half and 17 px on the right, plus
    noise.
    """
    rng = np.random.default_rng(seed)
    left = gaussian_filter(rng.normal(0, 120, (height, width)), 1.0) + 128
    disparity = np.where(np.arange(width) < width // 2, 10, 17)
    right = left[:, np.minimum(np.arange(width) + disparity, width - 1)]
    noisy = [
        np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        for image in (left, right)
    ]
    return noisy[0], noisy[1]


def census_strings(image: np.ndarray) -> np.ndarray:
    """[Zhang, Eq. 2], as (h, w, 62) truth values: False where the neighbour is brighter than the
    centre.
    """
    height, width = image.shape
    bordered = np.pad(image, ((HALF_HEIGHT, HALF_HEIGHT), (HALF_WIDTH, HALF_WIDTH)), mode="edge")
    neighbours = [
        bordered[dy : dy + height, dx : dx + width]
        for dy in range(2 * HALF_HEIGHT + 1)
        for dx in range(2 * HALF_WIDTH + 1)
        if (dy, dx) != (HALF_HEIGHT, HALF_WIDTH)
    ]
    return np.stack(neighbours, -1) <= image[..., None]


def matching_costs(left: np.ndarray, right: np.ndarray, config: StereoConfig) -> np.ndarray:
    """[Zhang, Eq. 3] for the left columns from `min_disparity` on; the right image goes on as
    its border.
    """
    reach = config.num_disparities - 1
    left_strings = census_strings(left)[:, config.min_disparity :]
    right_strings = census_strings(np.pad(right, ((0, 0), (reach, 0)), mode="edge"))
    width = left_strings.shape[1]
    costs = [
        (left_strings != right_strings[:, reach - d : reach - d + width]).sum(-1)
        for d in range(config.num_disparities)
    ]
    return np.stack(costs, -1)


def path_cost(costs: np.ndarray, dy: int, dx: int, P1: int, P2: int) -> np.ndarray:
    """[Zhang, Eq. 4] along direction (dy, dx), one pixel at a time."""
    height, width, _ = costs.shape
    result = costs.copy()
    for y in range(height) if dy >= 0 else reversed(range(height)):
        for x in range(width) if dx >= 0 else reversed(range(width)):
            if 0 <= y - dy < height and 0 <= x - dx < width:
                previous = result[y - dy, x - dx]
                beside = np.pad(previous, 1, constant_values=10**6)
                step = np.minimum(beside[:-2], beside[2:]) + P1
                best = np.minimum(np.minimum(previous, step), previous.min() + P2)
                result[y, x] = costs[y, x] + best - previous.min()
    return result


def reference_disparity(left: np.ndarray, right: np.ndarray, config: StereoConfig) -> np.ndarray:
    costs = matching_costs(left, right, config)
    directions = COLUMNS_AND_ROWS + (DIAGONALS if config.paths == 8 else [])
    total = sum(path_cost(costs, *direction, config.P1, config.P2) for direction in directions)
    height, width, count = total.shape
    result = np.full(left.shape, np.nan, np.float32)
    for y in range(height):
        right_best = np.full(width, 10**6)
        for x in range(width):
            for d in range(min(x + 1, count)):
                right_best[x - d] = min(right_best[x - d], total[y, x, d])
        for x in range(width):
            d = count - 1 - np.argmin(total[y, x, ::-1])  # of equal ones the nearest surface
            if not (0 < d < count - 1 and d <= x):
                continue
            near = [
                total[y, x - d + k, k]
                for k in range(d - config.consistency_px, d + config.consistency_px + 1)
                if 0 <= k < count and 0 <= x - d + k < width
            ]
            if right_best[x - d] in near:
                result[y, x + config.min_disparity] = (
                    config.min_disparity + d + sub_pixel(total[y, x], d, config)
                )
    return result


def sub_pixel(total: np.ndarray, d: int, config: StereoConfig) -> float:
    below, lowest, above = (int(value) for value in total[d - 1 : d + 2])
    span = (
        max(below, above) - lowest
        if config.subpixel == "equiangular"
        else below + above - 2 * lowest
    )
    return (below - above) / (2 * span) if span else 0.0


@pytest.mark.parametrize("paths", [4, 8])
@pytest.mark.parametrize("subpixel", ["equiangular", "parabola"])
@pytest.mark.parametrize(("height", "width"), [(19, 75), (40, 50), (1, 64), (2, 36)])
def test_disparities_equal_the_equations_written_out(paths, subpixel, height, width):
    config = dataclasses.replace(SMALL, paths=paths, subpixel=subpixel)
    left, right = pair_with_steps(height, width, seed=height)
    np.testing.assert_array_equal(
        disparity_map(left, right, config), reference_disparity(left, right, config)
    )


def test_disparities_equal_the_equations_over_more_than_one_vector_and_stiffest_penalties():
    config = StereoConfig(
        min_disparity=0,
        num_disparities=96,
        P1=63,
        P2=63,
        consistency_px=0,
        speckle_px=0,
        median_px=1,
        mean_px=1,
    )
    left, right = pair_with_steps(15, 140, seed=4)
    np.testing.assert_array_equal(
        disparity_map(left, right, config), reference_disparity(left, right, config)
    )


def test_census_bit_is_zero_only_where_the_neighbour_is_brighter():
    image = np.random.default_rng(0).integers(0, 8, (11, 45)).astype(np.uint8)
    bits = np.unpackbits(census(image), axis=1, bitorder="little")[:, :62, :45]
    planes_last = bits.reshape(11, 62, 45).transpose(0, 2, 1)
    np.testing.assert_array_equal(planes_last.astype(bool), census_strings(image))


def test_shifted_pair_gives_its_shift_everywhere_it_is_seen_twice():
    scene = gaussian_filter(np.random.default_rng(1).normal(0, 120, (60, 300)), 1.0) + 128
    scene = np.clip(scene, 0, 255).astype(np.uint8)
    left, right = scene[:, :220], scene[:, 70:290]
    disparity = disparity_map(left, right, StereoConfig(min_disparity=48, num_disparities=64))
    assert np.isnan(disparity[:, :48]).all()
    inside = disparity[:, 80:]
    assert np.isfinite(inside).mean() > 0.99
    assert np.nanmax(np.abs(inside - 70)) < 0.5


@pytest.mark.parametrize("paths", [4, 8])
def test_skin_that_both_cameras_see_is_matched_to_a_tenth_of_a_pixel(paths):
    """Off the steep rim, at 540 mm, where .1 px is .4 mm."""
    scene = DomeScene()
    pair = scene.pair()
    disparity = disparity_map(pair.left, pair.right, StereoConfig(paths=paths))
    skin = scene.on_dome & scene.seen_twice
    assert np.isfinite(disparity[skin]).mean() > 0.98
    from_axis = np.linalg.norm(scene.points[..., :2] - scene.sphere_centre[:2], axis=-1)
    error = (disparity - scene.disparity)[skin & (from_axis < 0.065)]
    assert np.sqrt(np.nanmean(error**2)) < 0.1
    assert abs(np.nanmedian(error)) < 0.03


def test_equiangular_fit_is_not_drawn_to_whole_pixels_as_a_parabola_is():
    """Mean error against the fraction of the true disparity: the spread of its means over ten
    bins.
    """
    scene = DomeScene()
    pair = scene.pair()
    fraction = np.floor(10 * (scene.disparity % 1)).astype(int)
    locking_px = {}
    for subpixel in ("equiangular", "parabola"):
        config = StereoConfig(subpixel=subpixel, median_px=1, mean_px=1)
        error = disparity_map(pair.left, pair.right, config) - scene.disparity
        sound = scene.on_dome & scene.seen_twice & (np.abs(error) < 1)
        locking_px[subpixel] = np.std(
            [error[sound & (fraction == tenth)].mean() for tenth in range(10)]
        )
    assert locking_px["equiangular"] < 0.01
    assert locking_px["parabola"] > 0.03


def test_the_coarse_pass_finds_a_range_that_holds_all_that_is_seen_and_not_much_more():
    """The room's disparities go from 72 to 140 px, the dome's with its table from 101 to 132 px."""
    for pair, truth, seen in (
        ((room := edge_pair()), room.disparity, room.seen_twice),
        ((scene := DomeScene()).pair(), scene.disparity, scene.seen_twice),
    ):
        smallest, count = disparity_range(pair.left, pair.right, StereoConfig())
        assert smallest < truth[seen].min()
        assert truth[seen].max() < smallest + count - 1
        assert count <= np.ptp(truth[seen]) + 2 * 16 + 32
        np.testing.assert_array_equal(
            disparity_map(pair.left, pair.right, StereoConfig()),
            disparity_map(
                pair.left, pair.right, StereoConfig(min_disparity=smallest, num_disparities=count)
            ),
        )


def test_a_range_that_is_given_is_kept():
    pair = DomeScene().pair()
    assert disparity_range(pair.left, pair.right, StereoConfig(min_disparity=90))[0] == 90
    assert disparity_range(pair.left, pair.right, StereoConfig(num_disparities=256))[1] == 256


def test_repeated_runs_agree_bit_for_bit():
    left, right = pair_with_steps(64, 200, seed=2)
    first, second = (disparity_map(left, right, StereoConfig(min_disparity=0)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_pair_of_two_sizes_is_refused():
    with pytest.raises(PerceptionError, match="one size, got 80x40 px"):
        disparity_map(np.zeros((40, 80), np.uint8), np.zeros((40, 81), np.uint8), SMALL)


def test_image_narrower_than_the_smallest_disparity_is_refused():
    with pytest.raises(PerceptionError, match="min_disparity = 64"):
        disparity_map(
            *np.zeros((2, 40, 64), np.uint8), StereoConfig(min_disparity=64, num_disparities=32)
        )


def test_featureless_pair_yields_no_agreeing_depth_of_more_than_noise():
    flat = np.full((30, 90), 100, np.uint8)
    assert np.isnan(disparity_map(flat, flat, SMALL)).all()
    assert np.isnan(disparity_map(flat, flat, StereoConfig())).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"num_disparities": 100},
        {"num_disparities": 0},
        {"min_disparity": -1},
        {"P1": 0},
        {"P1": 64},
        {"P2": 64},
        {"consistency_px": -1},
        {"speckle_px": -1},
        {"paths": 4, "P2": 64},
        {"num_disparities": 2080},
    ],
)
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ConfigError, match=str(next(reversed(wrong.values())))):
        StereoConfig(**wrong)
