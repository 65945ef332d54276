"""Table 4 as transcribed gives the figures that the paper claims, and a run is compared on the
same footing.
"""

import numpy as np
import pytest

from breastscan.report import paper

PRINTED_DIGIT = 0.005
"""Half of the last digit that the paper prints [mm]."""

PRINTED_ABSOLUTE_ERRORS_MM = np.array(
    [
        [1.5, 0.3, 0.3],
        [0.3, 0.2, 0.4],
        [0.3, 0.4, 0.3],
        [0.6, 0.5, 0.7],
        [0.7, 0.2, 0.6],
        [1.1, 0.1, 0.8],
        [0.9, 0.3, 1.3],
        [0.6, 0.9, 1.8],
        [0.8, 0.7, 1.6],
        [0.9, 0.8, 0.2],
        [0.4, 0.5, 0.3],
        [1.3, 0.6, 1.7],
        [1.6, 0.4, 0.8],
        [0.2, 1.3, 1.2],
        [0.7, 0.2, 1.3],
    ]
)
"""The error columns of Table 4 without their signs, which the paper mixes: a check on the
transcribed coordinates."""


def test_the_transcribed_points_differ_by_the_errors_that_the_paper_prints():
    differences_mm = np.abs(paper.TABLE4_ACTUAL_MM - paper.TABLE4_THEORETICAL_MM)
    np.testing.assert_allclose(differences_mm, PRINTED_ABSOLUTE_ERRORS_MM, atol=1e-9)


@pytest.mark.parametrize(
    ("statistic", "published_mm"),
    [
        ("mean_abs_mm", [0.79, 0.49, 0.89]),
        ("rms_mm", [0.90, 0.58, 1.04]),
        ("deviation_mm", [0.91, 0.59, 1.03]),
    ],
)
def test_table_4_gives_the_published_statistics(statistic, published_mm):
    recomputed_mm = getattr(paper.table4_statistics(), statistic)
    np.testing.assert_allclose(recomputed_mm, published_mm, atol=PRINTED_DIGIT + 1e-9)


def test_a_constant_error_has_no_deviation_but_its_own_size_as_mean_and_rms():
    constant = paper.statistics(np.tile([0.3, -0.4, 0.5], (10, 1)))
    np.testing.assert_allclose(constant.mean_abs_mm, [0.3, 0.4, 0.5])
    np.testing.assert_allclose(constant.rms_mm, [0.3, 0.4, 0.5])
    np.testing.assert_allclose(constant.deviation_mm, 0.0, atol=1e-12)


def test_mean_square_is_bias_squared_plus_variance():
    errors_mm = np.random.default_rng(3).normal([0.2, -0.5, 1.0], [0.4, 0.1, 0.7], size=(200, 3))
    found = paper.statistics(errors_mm)
    variance = found.deviation_mm**2 * (len(errors_mm) - 1) / len(errors_mm)
    np.testing.assert_allclose(found.rms_mm**2, errors_mm.mean(axis=0) ** 2 + variance, rtol=1e-12)


def test_the_paper_compared_with_itself_is_equal_in_every_statistic():
    for line in paper.compare_table4(paper.TABLE4_ACTUAL_MM - paper.TABLE4_THEORETICAL_MM):
        np.testing.assert_array_equal(line.ours_mm, line.paper_mm)


def test_a_single_error_has_no_statistics():
    with pytest.raises(ValueError, match="at least two"):
        paper.statistics(np.zeros((1, 3)))
