import numpy as np
import pytest
from scipy.spatial.distance import cdist

from experiments.paper import sampling

SIDE = 60
"""Points along a side of the square that is sampled."""


@pytest.fixture(scope="module")
def cloud():
    """A square of .1 m with a little noise."""
    x, y = np.meshgrid(*2 * [np.linspace(0, 0.1, SIDE)])
    noise = np.random.default_rng(1).normal(0, 1e-4, x.size)
    return np.stack([x.ravel(), y.ravel(), 0.4 + noise], axis=1)


@pytest.fixture(scope="module")
def rows(cloud):
    edge = np.abs(cloud[:, :2] - 0.05).max(axis=1) > 0.047
    cells = (8e-3, 5e-3, 4e-3)
    found = sampling.compared(cloud, edge, np.ones(len(cloud)), seed=0, cells=cells)
    return {row.name: row for row in found}


def test_a_lattice_is_even_and_points_at_random_are_not():
    lattice = np.stack([*np.mgrid[:20.0, :20.0].reshape(2, -1), np.zeros(400)], axis=1)
    assert sampling.unevenness(lattice) == (1.0, 0.0)
    random = np.random.default_rng(0).uniform(0, 1, (20_000, 3)) * [1, 1, 0]
    assert sampling.unevenness(random)[1] == pytest.approx(0.523, abs=0.01)


def test_spacing_gap_and_edges_are_those_of_all_distances_written_out(cloud, rows):
    for row in rows.values():
        kept = cloud[row.chosen]
        between = cdist(kept, kept)
        np.fill_diagonal(between, np.inf)
        nearest = between.min(axis=1)
        assert row.spacing_mm == pytest.approx(1e3 * nearest.mean())
        assert row.unevenness == pytest.approx(nearest.std() / nearest.mean())
        assert row.gap_mm == pytest.approx(1e3 * cdist(cloud, kept).min(axis=1).max())


def test_only_the_grid_does_not_give_the_number_that_was_asked_for(rows):
    grid = rows["grid, 5 mm"]
    assert grid.requested == 0
    for name in ("uniform", "geometric"):
        assert rows[name].requested == len(rows[name].chosen) == len(grid.chosen)


def test_uniform_sampling_is_the_most_even_and_fond_of_edges(rows):
    uniform, geometric = rows["uniform"], rows["geometric"]
    assert uniform.unevenness < geometric.unevenness
    assert uniform.gap_mm < min(row.gap_mm for row in (geometric, rows["grid, 5 mm"]))
    assert uniform.edge_ratio > geometric.edge_ratio
