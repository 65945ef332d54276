import numpy as np
from scipy.interpolate import NdBSpline

from breastscan.geometry import banded, bicubic

ROWS, COLUMNS = 9, 7
RNG = np.random.default_rng(0)
COEFFICIENTS = RNG.normal(size=(ROWS, COLUMNS))
PLACES = RNG.uniform([0, 0], [ROWS - 3, COLUMNS - 3], (50, 2))


def test_values_and_derivatives_are_those_of_scipys_splines():
    knots = tuple(np.arange(count + 4) - 3.0 for count in (ROWS, COLUMNS))
    oracle = NdBSpline(knots, COEFFICIENTS, 3)
    orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    expected = np.stack([oracle(PLACES, nu=order) for order in orders], axis=1)
    np.testing.assert_allclose(bicubic.values(COEFFICIENTS, PLACES), expected, atol=1e-12)


def test_weights_give_the_value():
    first, weights = bicubic.first_numbers(PLACES, ROWS, COLUMNS)
    k = np.arange(16)
    numbers = first[:, None] + k // 4 * COLUMNS + k % 4
    value = np.sum(weights * COEFFICIENTS.ravel()[numbers], axis=1)
    np.testing.assert_allclose(value, bicubic.values(COEFFICIENTS, PLACES)[:, 0], atol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)


def test_normal_equations_and_variances_are_the_dense_ones():
    first, weights = bicubic.first_numbers(PLACES, ROWS, COLUMNS)
    design = np.zeros((len(PLACES), ROWS * COLUMNS))
    for k in range(16):
        design[np.arange(len(PLACES)), first + k // 4 * COLUMNS + k % 4] = weights[:, k]
    precision, target = RNG.uniform(1, 2, len(PLACES)), RNG.normal(size=len(PLACES))
    band = bicubic.bandwidth(COLUMNS)
    matrix = bicubic.banded(bicubic.bending(ROWS, COLUMNS), band)
    right_side = np.zeros(ROWS * COLUMNS)
    bicubic.add_normal_equations(first, weights, precision, target, COLUMNS, matrix, right_side)
    dense = design.T @ (precision[:, None] * design) + bicubic.bending(ROWS, COLUMNS).toarray()
    np.testing.assert_allclose(right_side, design.T @ (precision * target), atol=1e-12)
    covariance = banded.inverse_within_band(banded.factorized(matrix))
    expected = np.einsum("ni,ij,nj->n", design, np.linalg.inv(dense), design)
    np.testing.assert_allclose(
        bicubic.variances(covariance, PLACES, ROWS, COLUMNS), expected, rtol=1e-8
    )


def test_quadratic_shapes_cost_no_bending():
    x, y = np.mgrid[:ROWS, :COLUMNS]
    quadratic = (1 + 2 * x - y + x * x - 3 * x * y + 0.5 * y * y).ravel()
    assert abs(quadratic @ bicubic.bending(ROWS, COLUMNS) @ quadratic) < 1e-9
