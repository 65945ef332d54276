import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from breastscan.cloud.filters import (
    geometric_sample,
    grid_sample,
    statistical_inliers,
    uniform_sample,
)
from breastscan.cloud.normals import surface_variation


def plate(count: int, seed: int = 0) -> np.ndarray:
    """Points scattered over a square of 100 mm [m]."""
    return np.random.default_rng(seed).uniform([-0.05, -0.05, 0.5], [0.05, 0.05, 0.5], (count, 3))


def plate_with_ridge() -> np.ndarray:
    """A grid of 1 mm pitch on a square of 100 mm with a rounded ridge along y, 8 mm high and 12
    mm wide.
    """
    x, y = np.meshgrid(np.arange(-50, 51) * 1e-3, np.arange(-50, 51) * 1e-3)
    return np.stack([x, y, 0.5 - 8e-3 * np.exp(-0.5 * (x / 4e-3) ** 2)], axis=-1).reshape(-1, 3)


def test_denoising_removes_stray_points_and_keeps_the_surface():
    surface = plate(2000)
    strays = np.random.default_rng(1).uniform([-0.05, -0.05, 0.3], [0.05, 0.05, 0.45], (20, 3))
    kept = statistical_inliers(np.vstack([surface, strays]))
    assert not kept[2000:].any()
    assert kept[:2000].mean() > 0.98


def test_denoising_is_equation_12_with_both_bounds():
    points = np.random.default_rng(2).normal(0, 1, (60, 3))
    kept = statistical_inliers(points, k=4, alpha=1.0)
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    mean_distance = np.sort(distance, axis=1)[:, 1:5].mean(axis=1)
    low, high = (
        mean_distance.mean() - mean_distance.std(),
        mean_distance.mean() + mean_distance.std(),
    )
    np.testing.assert_array_equal(kept, (low <= mean_distance) & (mean_distance <= high))
    assert (mean_distance < low).any()
    assert (mean_distance > high).any()


def test_grid_sampling_keeps_exactly_one_point_a_cell():
    points = plate(3000)
    kept = points[grid_sample(points, 5e-3)]
    cells = np.floor(kept / 5e-3).astype(int)
    assert (
        len(np.unique(cells, axis=0))
        == len(kept)
        == len(np.unique(np.floor(points / 5e-3).astype(int), axis=0))
    )


def test_grid_sampling_keeps_the_point_nearest_to_the_cells_mean():
    points = np.array([[0.1, 0.1, 0.1], [0.4, 0.4, 0.4], [0.9, 0.9, 0.9], [1.5, 0.5, 0.5]])
    assert grid_sample(points, 1.0).tolist() == [1, 3]


LATTICE = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3)
"""Many of whose points are as far as one another: the first of them is chosen."""


@pytest.mark.parametrize(
    "points",
    [np.random.default_rng(5).normal(0, 1, (80, 3)), LATTICE, np.ones((30, 3))],
    ids=["random", "lattice", "one place"],
)
def test_uniform_sampling_is_farthest_point_sampling(points):
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    for _ in range(19):
        gap = np.linalg.norm(points[:, None] - points[chosen], axis=-1).min(axis=1)
        gap[chosen] = -1.0  # none is chosen twice, in whichever place it lies
        chosen.append(int(np.argmax(gap)))
    assert uniform_sample(points, 20).tolist() == chosen


@pytest.mark.parametrize("shape", ["surface", "volume", "lattice", "line", "a far point"])
def test_uniform_sampling_of_a_large_cloud_is_farthest_point_sampling(shape):
    points = large_cloud(shape)
    squared = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    expected = [int(np.argmax(squared))]
    squared[:] = np.inf
    for _ in range(299):
        squared = np.minimum(squared, ((points - points[expected[-1]]) ** 2).sum(axis=1))
        expected.append(int(np.argmax(squared)))
    assert uniform_sample(points, 300).tolist() == expected


def large_cloud(shape: str) -> np.ndarray:
    rng = np.random.default_rng(7)
    points = rng.uniform(-0.1, 0.1, (20_000, 3))
    if shape == "surface":
        points[:, 2] = 0.5 - 0.05 * np.exp(-(points[:, 0] ** 2 + points[:, 1] ** 2) / 0.05**2)
    if shape == "lattice":
        points = np.round(points / 8e-3)  # several in one place, many equally far
    if shape == "line":
        points[:, 1:] = 0.3
    if shape == "a far point":
        points[11] = 1e9
    return points


def test_uniform_sampling_gives_every_place_before_any_comes_twice():
    places = np.random.default_rng(3).normal(0, 1, (50, 3))
    points = places[np.random.default_rng(4).permutation(np.repeat(np.arange(50), 40))]
    kept = uniform_sample(points, 300)
    assert len(np.unique(points[kept[:50]], axis=0)) == 50
    assert len(set(kept.tolist())) == 300
    assert (np.diff(kept[50:]) > 0).all()


def test_two_hundred_thousand_points_in_one_place_are_all_alike():
    points = np.full((200_000, 3), 0.37)
    assert statistical_inliers(points).all()
    assert uniform_sample(points, 2000).tolist() == list(range(2000))
    assert grid_sample(points, 1e-3).tolist() == [0]
    variation = surface_variation(points)
    np.testing.assert_array_equal(variation, 0.0)
    assert len(set(geometric_sample(points, variation, 2000).tolist())) == 2000


EVERY = [
    statistical_inliers,
    lambda p: grid_sample(p, 5e-3),
    lambda p: uniform_sample(p, 5),
    lambda p: geometric_sample(p, np.ones(len(p)), 5),
]


@pytest.mark.parametrize("call", EVERY)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200])
def test_coordinates_that_are_not_finite_are_told_with_their_number_and_place(call, value):
    points = plate(100)
    points[[17, 40], 1] = value
    with pytest.raises(ValueError, match="finite, 2 of 100 points are not, the first is point 17"):
        call(points)


@pytest.mark.parametrize("call", EVERY)
def test_a_cloud_without_points_is_refused(call):
    with pytest.raises(ValueError, match="1 point or more, got 0"):
        call(np.empty((0, 3)))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_variations_that_are_no_weights_are_refused(wrong):
    variation = np.ones(10)
    variation[3] = wrong
    with pytest.raises(ValueError, match="not negative, 1 of 10 are not"):
        geometric_sample(plate(10), variation, 5)


def test_uniform_sampling_spaces_points_evenly_and_reaches_the_corners():
    """400 points on 100 x 100 mm: random choice leaves neighbours .1 mm apart, farthest points
    stay above 3.5 mm.
    """
    points = plate(5000)
    kept = points[uniform_sample(points, 400)]
    gaps = np.linalg.norm(kept[:, None] - kept, axis=-1) + np.eye(400)
    assert gaps.min() > 3.5e-3
    corners = np.array([[sx * 0.05, sy * 0.05, 0.5] for sx in (-1, 1) for sy in (-1, 1)])
    assert np.linalg.norm(kept[:, None] - corners, axis=-1).min(axis=0).max() < 5e-3


def test_geometric_sampling_is_denser_where_the_surface_bends():
    points = plate_with_ridge()
    kept = points[geometric_sample(points, surface_variation(points, radius=4e-3), 2000)]
    fraction_kept_on_ridge = np.mean(np.abs(kept[:, 0]) < 8e-3) / np.mean(
        np.abs(points[:, 0]) < 8e-3
    )
    fraction_kept_on_plate = np.mean(np.abs(kept[:, 0]) > 20e-3) / np.mean(
        np.abs(points[:, 0]) > 20e-3
    )
    assert fraction_kept_on_ridge > 2 * fraction_kept_on_plate > 0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), count=st.integers(1, 200))
def test_samples_are_distinct_points_of_the_cloud(seed, count):
    points = plate(200, seed)
    for kept in (uniform_sample(points, count), geometric_sample(points, np.ones(200), count)):
        assert len(set(kept.tolist())) == count
        assert 0 <= kept.min() <= kept.max() < 200


@pytest.mark.parametrize(
    "call",
    [
        lambda p: statistical_inliers(p, alpha=0.0),
        lambda p: statistical_inliers(p, k=10),
        lambda p: grid_sample(p, 0.0),
        lambda p: grid_sample(p, np.nan),
        lambda p: grid_sample(p, 1e-30),
        lambda p: statistical_inliers(p, alpha=np.nan),
        lambda p: uniform_sample(p, 11),
        lambda p: uniform_sample(p, 0),
        lambda p: geometric_sample(p, np.ones(10), 11),
    ],
)
def test_arguments_that_make_no_sense_are_refused(call):
    with pytest.raises(ValueError, match="must be"):
        call(plate(10))
