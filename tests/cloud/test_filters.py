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
        chosen.append(int(np.argmax(gap)))
    assert uniform_sample(points, 20).tolist() == chosen


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
        lambda p: uniform_sample(p, 11),
        lambda p: uniform_sample(p, 0),
        lambda p: geometric_sample(p, np.ones(10), 11),
    ],
)
def test_arguments_that_make_no_sense_are_refused(call):
    with pytest.raises(ValueError, match="must be"):
        call(plate(10))
