"""Scatter of numbers of which some are anything."""

import numpy as np
import pytest

from breastscan.geometry import robust


def test_the_deviation_of_normal_numbers_is_theirs_and_outliers_hardly_change_it():
    values = np.random.default_rng(0).normal(0.0, 0.3, 100_000)
    assert robust.deviation(values) == pytest.approx(0.3, rel=0.01)
    values[:5000] = 1e6
    assert robust.deviation(values) == pytest.approx(0.3, rel=0.08)
