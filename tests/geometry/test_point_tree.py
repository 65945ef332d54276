"""The tree's invariants, and its nearest points against SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from breastscan.geometry.point_tree import nearest, point_tree


def cloud(seed: int, count: int, steps: int) -> np.ndarray:
    """Points in a box, on so many steps of each side, so that some lie in one place; 0 for any."""
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [1, 0.3, 0.01]
    return np.round(points * steps) / steps if steps else points


CLOUDS = given(
    seed=st.integers(0, 999), count=st.integers(1, 3000), steps=st.sampled_from([0, 1, 9])
)


@settings(max_examples=40, deadline=None)
@CLOUDS
def test_nodes_halve_the_points_in_tight_boxes(seed, count, steps):
    points = cloud(seed, count, steps)
    tree = point_tree(points, 8)
    np.testing.assert_array_equal(tree.points, points[tree.order])
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(count))
    leaves = len(tree.first) // 2
    for node in range(1, 2 * leaves):
        inside = tree.points[tree.first[node] : tree.end[node]]
        np.testing.assert_array_equal(tree.low[node], inside.min(axis=0))
        np.testing.assert_array_equal(tree.high[node], inside.max(axis=0))
        if node < leaves:
            left, right = 2 * node, 2 * node + 1
            assert tree.first[node] == tree.first[left]
            assert tree.end[left] == tree.first[right]
            assert tree.end[right] == tree.end[node]
            axis = int(np.argmax(tree.high[node] - tree.low[node]))
            assert tree.high[left, axis] <= tree.low[right, axis]
    sizes = (tree.end - tree.first)[leaves:]
    assert sizes.max() <= 8
    assert np.ptp(sizes) <= 1


@settings(max_examples=40, deadline=None)
@CLOUDS
def test_the_nearest_points_are_scipys(seed, count, steps):
    points = cloud(seed, count, steps)
    tree, k = point_tree(points), min(count, 7)
    squared, found = np.empty(k), np.empty(k, np.int64)
    for query in (*points[:5], *np.add(cloud(seed + 1, 5, 0), [0, 0, 0.3])):
        nearest(tree, query, squared, found)
        expected = np.atleast_1d(KDTree(points).query(query, k)[0])
        np.testing.assert_allclose(np.sort(np.sqrt(squared)), expected, atol=1e-15)
        at = np.linalg.norm(tree.points[found] - query, axis=1)
        np.testing.assert_allclose(at, np.sqrt(squared), atol=1e-15)
        assert len(set(found.tolist())) == k


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_no_tree_of_points_that_are_not_finite(value):
    with pytest.raises(ValueError, match="2 of 9 points are not, the first is point 4"):
        point_tree(np.where(np.isin(np.arange(9), [4, 8])[:, None], value, np.zeros((9, 3))))
