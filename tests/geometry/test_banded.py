import numpy as np
import pytest

from breastscan.geometry.banded import factorized, inverse_within_band, product, solved


def random_band(size: int = 30, band: int = 6, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A banded positive definite matrix, in banded and in full form."""
    rng = np.random.default_rng(seed)
    upper = np.triu(rng.normal(0, 1, (size, size))) * (
        np.subtract.outer(range(size), range(size)) > -band
    )
    full = upper.T @ upper + np.eye(size)
    banded = np.array(
        [[full[j, j + k] if j + k < size else 0.0 for k in range(band)] for j in range(size)]
    )
    return banded, full


@pytest.mark.parametrize(("size", "band"), [(30, 6), (4, 9), (1, 1)])
def test_solution_is_numpys(size, band):
    banded, full = random_band(size, band)
    right_side = np.random.default_rng(1).normal(0, 1, size)
    np.testing.assert_allclose(
        solved(factorized(banded), right_side), np.linalg.solve(full, right_side), rtol=1e-9
    )


@pytest.mark.parametrize(("size", "band"), [(30, 6), (4, 9), (1, 1)])
def test_inverse_within_the_band_is_numpys(size, band):
    banded, full = random_band(size, band)
    inverse, within = np.linalg.inv(full), inverse_within_band(factorized(banded))
    for k in range(min(size, band)):
        np.testing.assert_allclose(within[: size - k, k], np.diagonal(inverse, k), atol=1e-12)


def test_indefinite_matrix_is_refused():
    banded, _ = random_band()
    banded[7, 0] = -1.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        factorized(banded)


def test_product_is_numpys():
    a, b = (
        np.random.default_rng(2).normal(0, 1, (7, 5)),
        np.random.default_rng(3).normal(0, 1, (5, 9)),
    )
    np.testing.assert_allclose(product(a, b), a @ b)
