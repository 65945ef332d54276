import numpy as np
import pytest
from scipy.interpolate import BSpline

from breastscan.geometry.banded import factorized
from breastscan.vision.refining.spline_field import SplineField

FIELD = SplineField(rows=3, columns=4, spacing=5)
COEFFICIENTS = np.random.default_rng(0).normal(0, 1, FIELD.size)


def design_matrix() -> np.ndarray:
    """Every pixel's dependence on every coefficient, cell by cell, from SciPy's B-splines."""
    y, x = [
        BSpline.design_matrix(
            (np.arange(5 * cells) + 0.5) / 5, np.arange(-3.0, cells + 4), 3
        ).toarray()
        for cells in (FIELD.rows, FIELD.columns)
    ]
    region = np.einsum("yi,xj->yxij", y, x).reshape(15, 20, -1)
    return np.stack([FIELD.to_cells(region[..., n]) for n in range(FIELD.size)], axis=-1).reshape(
        -1, FIELD.size
    )


def symmetric(band: np.ndarray) -> np.ndarray:
    matrix = np.diag(band[:, 0])
    for above in range(1, band.shape[1]):
        entries = band[: len(band) - above, above]
        matrix += np.diag(entries, above) + np.diag(entries, -above)
    return matrix


def test_field_is_scipys_bicubic_b_spline():
    np.testing.assert_allclose(
        FIELD.evaluate(COEFFICIENTS).ravel(), design_matrix() @ COEFFICIENTS, atol=1e-12
    )


def test_weights_sum_to_one_at_every_pixel():
    np.testing.assert_allclose(FIELD.weights.sum(axis=1), 1.0)


def test_normal_equations_are_those_of_the_design_matrix():
    values = np.random.default_rng(1).uniform(0, 1, (12, 25))
    design = design_matrix()
    np.testing.assert_allclose(
        symmetric(FIELD.normal_matrix(values)),
        design.T @ (values.reshape(-1, 1) * design),
        atol=1e-12,
    )
    np.testing.assert_allclose(FIELD.right_side(values), design.T @ values.ravel(), atol=1e-12)


def test_variance_is_the_inverse_information_seen_through_the_design_matrix():
    information = (
        FIELD.normal_matrix(np.random.default_rng(2).uniform(0, 1, (12, 25))) + FIELD.banded_bending
    )
    design = design_matrix()
    expected = np.sum(design @ np.linalg.inv(symmetric(information)) * design, axis=1)
    np.testing.assert_allclose(FIELD.variance(factorized(information)).ravel(), expected)


@pytest.mark.parametrize(
    ("shape", "bends"),
    [(lambda y, x: 3 + x * y - 2 * x**2 + y**2, False), (lambda y, x: x**2 * y, True)],
)
def test_bending_is_free_for_quadratic_fields_only(shape, bends):
    """B-spline coefficients of a quadratic are again a quadratic of their index."""
    y, x = np.mgrid[0:6, 0:7]
    coefficients = shape(y, x).astype(float).ravel()
    assert (coefficients @ (FIELD.bending @ coefficients) > 1e-6) == bends


def test_bending_survives_the_banded_form():
    np.testing.assert_allclose(symmetric(FIELD.banded_bending), FIELD.bending.toarray())


def test_cells_and_region_are_each_others_inverse():
    region = np.arange(300).reshape(15, 20)
    np.testing.assert_array_equal(FIELD.to_region(FIELD.to_cells(region)), region)
