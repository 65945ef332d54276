"""Eigenvalues and eigenvectors against NumPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from breastscan.geometry.symmetric import eigh3


def symmetric(seed: int, spread: float, count: int = 200) -> np.ndarray:
    """Matrices whose eigenvalues lie as far apart as the spread."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    values = 10.0 ** rng.uniform(-spread, spread, (count, 1, 3)) * rng.choice(
        [-1, 1], (count, 1, 3)
    )
    a = (axes * values) @ axes.transpose(0, 2, 1)
    return (a + a.transpose(0, 2, 1)) / 2


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.0, 8.0))
def test_they_are_numpys(seed, spread):
    a = symmetric(seed, spread)
    values, axes = eigh3(a)
    expected, expected_axes = np.linalg.eigh(a)
    size = np.abs(expected).max(axis=1)
    np.testing.assert_allclose(values / size[:, None], expected / size[:, None], atol=1e-14)
    gap = np.diff(expected, axis=1).min(axis=1) / size
    cosines = np.abs(np.sum(axes * expected_axes, axis=1))
    well = gap > 1e-5
    np.testing.assert_allclose(
        axes[well] * np.sign(np.sum(axes * expected_axes, axis=1))[well, None],
        expected_axes[well],
        atol=1e-9,
    )
    assert cosines[well].min(initial=1.0) > 1 - 1e-12


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0.0, 8.0))
def test_they_make_up_the_matrix_again(seed, spread):
    a = symmetric(seed, spread)
    values, axes = eigh3(a)
    again = (axes * values[:, None]) @ axes.transpose(0, 2, 1)
    size = np.abs(a).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(again / size, a / size, atol=1e-14)
    np.testing.assert_allclose(
        axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(3), (len(a), 1, 1)), atol=1e-14
    )


@pytest.mark.parametrize(
    "a",
    [
        np.zeros((3, 3)),
        np.eye(3),
        np.ones((3, 3)),
        np.diag([3.0, 1, 2]),
        1e-200 * np.ones((3, 3)),
        1e200 * np.ones((3, 3)),
    ],
)
def test_equal_and_vanishing_eigenvalues_have_axes_of_length_one(a):
    values, axes = eigh3(a[None])
    size = max(np.abs(a).max(), 1e-300)
    np.testing.assert_allclose(values[0] / size, np.linalg.eigvalsh(a) / size, atol=1e-14)
    np.testing.assert_allclose(axes[0].T @ axes[0], np.eye(3), atol=1e-14)
