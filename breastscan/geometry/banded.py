"""Symmetric positive definite systems of a narrow band, and small dense products, each on one
thread.

BLAS would serve, but starts threads whose waiting costs twenty times what these small problems
take.

Entry (j, j + k) of a banded matrix stands at [j, k]; the part below the diagonal is not kept.
"""

import numpy as np
from jaxtyping import Float

from breastscan.geometry.compiled import kernel


def factorized(matrix: Float[np.ndarray, "n band"]) -> Float[np.ndarray, "n band"]:
    """The upper triangular U with U^T U = `matrix`.

    Raises:
        numpy.linalg.LinAlgError: The matrix is not positive definite.
    """
    factor = matrix.copy()
    if not _factorize(factor):
        raise np.linalg.LinAlgError("the banded matrix is not positive definite")
    return factor


def solved(
    factor: Float[np.ndarray, "n band"], right_side: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """The x with U^T U x = `right_side`."""
    x = right_side.copy()
    _substitute(factor, x)
    return x


def inverse_within_band(factor: Float[np.ndarray, "n band"]) -> Float[np.ndarray, "n band"]:
    """Those entries of (U^T U)^-1 that lie within the band [Takahashi 1973]."""
    inverse = np.zeros_like(factor)
    _invert_within_band(factor, inverse)
    return inverse


@kernel
def product(a, b):
    """`a @ b`."""
    result = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            factor = a[i, k]
            if factor != 0.0:  # most of a cell at an object's rim is outside the object
                for j in range(b.shape[1]):
                    result[i, j] += factor * b[k, j]
    return result


@kernel
def _add_multiple(target, factor, source):
    """`target += factor * source`, in a loop that the compiler turns into vector instructions."""
    for k in range(target.size):
        target[k] += factor * source[k]


@kernel
def _factorize(matrix):
    """Four pivots at a time: each row below them is fetched from memory once for all four."""
    size, band = matrix.shape
    for first in range(0, size, 4):
        end = min(first + 4, size)
        for pivot in range(first, end):
            if not matrix[pivot, 0] > 0.0:
                return False
            matrix[pivot] /= np.sqrt(matrix[pivot, 0])
            for i in range(1, min(band, end - pivot)):
                _add_multiple(matrix[pivot + i, : band - i], -matrix[pivot, i], matrix[pivot, i:])
        for row in range(end, min(first + band, size)):
            shared = band - (row - first)  # entries that all four pivots reach
            _subtract_products(
                matrix[row, :shared],
                matrix[first, row - first :],
                matrix[first + 1, row - first - 1 :],
                matrix[first + 2, row - first - 2 :],
                matrix[first + 3, row - first - 3 :],
            )
            for pivot in range(first + 1, end):
                i = row - pivot
                _add_multiple(
                    matrix[row, shared : band - i], -matrix[pivot, i], matrix[pivot, i + shared :]
                )
        for row in range(min(first + band, size), min(first + 3 + band, size)):
            for pivot in range(row - band + 1, end):
                i = row - pivot
                _add_multiple(matrix[row, : band - i], -matrix[pivot, i], matrix[pivot, i:])
    return True


@kernel
def _subtract_products(target, a, b, c, d):
    """`target -= a[0] a + b[0] b + c[0] c + d[0] d`, over the target's length."""
    a0 = a[0]
    b0 = b[0]
    c0 = c[0]
    d0 = d[0]
    for k in range(target.size):
        target[k] -= a0 * a[k] + b0 * b[k] + c0 * c[k] + d0 * d[k]


@kernel
def _substitute(factor, x):
    size, band = factor.shape
    for j in range(size):
        x[j] /= factor[j, 0]
        for k in range(1, min(band, size - j)):
            x[j + k] -= factor[j, k] * x[j]
    for j in range(size - 1, -1, -1):
        for k in range(1, min(band, size - j)):
            x[j] -= factor[j, k] * x[j + k]
        x[j] /= factor[j, 0]


@kernel
def _invert_within_band(factor, inverse):
    """Row by row from the last: Z U^T = U^-1 is upper triangular with 1 / U_jj on its diagonal."""
    size, band = factor.shape
    # of Z, entry (j, j + k) at [j, diagonal + k] on both sides of the diagonal
    rows = np.zeros((size, 2 * band - 1))
    diagonal = band - 1
    product_row = np.empty(band)
    for j in range(size - 1, -1, -1):
        reach = min(band, size - j)
        product_row[:] = 0.0  # of the known block of Z below and right of j with row j of U
        for i in range(1, reach):
            _add_multiple(
                product_row[1:], factor[j, i], rows[j + i, diagonal + 1 - i : diagonal + band - i]
            )
        for k in range(1, reach):
            inverse[j, k] = -product_row[k] / factor[j, 0]
            rows[j, diagonal + k] = rows[j + k, diagonal - k] = inverse[j, k]
            product_row[0] += inverse[j, k] * factor[j, k]
        inverse[j, 0] = (1.0 / factor[j, 0] - product_row[0]) / factor[j, 0]
        rows[j, diagonal] = inverse[j, 0]
