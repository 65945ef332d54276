import numpy as np
from scipy.spatial.distance import cdist

from experiments.paper import denoising


def test_every_k_keeps_the_points_that_all_distances_written_out_keep():
    rng = np.random.default_rng(3)
    points = np.vstack([rng.uniform(0, 0.05, (200, 3)) * [1, 1, 0.02], [[0.0, 0.0, 0.2]]])
    ordered = np.sort(cdist(points, points), axis=1)
    for row in denoising.denoised(points, range(2, 21, 6), (1.0, 2.0), repeats=1):
        mean = ordered[:, 1 : row.k + 1].mean(axis=1)
        expected = np.abs(mean - mean.mean()) <= row.alpha * mean.std()
        np.testing.assert_array_equal(row.kept, expected)
        assert not row.kept[-1]
        assert row.time > 0


def test_the_number_of_points_is_steady_from_where_it_no_longer_changes():
    assert denoising.steady_from([900, 950, 990, 1000, 1000, 1000]) == 3
    assert denoising.steady_from([1000, 1000, 1000]) == 0
    assert denoising.steady_from([1000, 1000, 900]) == 2
