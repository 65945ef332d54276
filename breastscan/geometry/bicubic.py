"""Bicubic B-splines on a square grid of evenly spaced knots, at scattered places.

Coefficients are numbered row by row: rows follow the first coordinate, columns the second. The cell
[i, i + 1) x [j, j + 1), in units of the spacing, depends on the coefficients i .. i + 3 by j .. j +
3.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from breastscan.geometry.compiled import kernel

THIRD_DIFFERENCES = ((0, 1), (1, 3), (2, 3), (3, 1))
"""Order along the rows, and how often such a third derivative counts in the rotation-invariant
sum of squares."""


def bending(rows: int, columns: int) -> sparse.csr_array:
    """Matrix of the sum of squared third differences of the coefficients: quadratic shapes cost
    nothing.
    """
    energy = sparse.csr_array((rows * columns, rows * columns))
    for difference, multiplicity in third_differences(rows, columns):
        energy = energy + multiplicity * (difference.T @ difference)
    return energy


def third_differences(rows: int, columns: int) -> list[tuple[sparse.csr_array, int]]:
    """The four kinds of third differences of the coefficients, and how often each counts."""
    along = _differences(rows), _differences(columns)
    return [
        (sparse.csr_array(sparse.kron(along[0][order], along[1][3 - order])), multiplicity)
        for order, multiplicity in THIRD_DIFFERENCES
    ]


def banded(matrix: sparse.csr_array, bandwidth: int) -> Float[np.ndarray, "n band"]:
    """A symmetric sparse matrix in the form that `geometry.banded` takes."""
    upper = sparse.triu(matrix).tocoo()
    band = np.zeros((upper.row.max() + 1, bandwidth + 1))
    band[upper.row, upper.col - upper.row] = upper.data
    return band


def bandwidth(columns: int) -> int:
    """Largest distance of the numbers of two coefficients that one place depends on."""
    return 3 * columns + 3


def _differences(count: int) -> list[sparse.csr_array]:
    """Matrices that take the differences of order 0 to 3 of `count` numbers."""
    return [sparse.csr_array(np.diff(np.eye(count), n=order, axis=0)) for order in range(4)]


def values(
    coefficients: Float[np.ndarray, "rows columns"], x: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 6"]:
    """Value, first derivatives along rows and columns, and second derivatives (rows twice, mixed,
    columns twice) at `x`, in units of the spacing; beyond the grid its outermost cells go on.
    """
    result = np.empty((len(x), 6))
    _values(coefficients, np.ascontiguousarray(x), result)
    return result


def first_numbers(
    x: Float[np.ndarray, "n 2"], rows: int, columns: int
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 16"]]:
    """Number of the first coefficient that each place depends on, and the weights of all sixteen;
    the k-th of them lies k // 4 rows and k % 4 columns further.
    """
    first, weights = np.empty(len(x), np.int64), np.empty((len(x), 16))
    _first_numbers(np.ascontiguousarray(x), rows, columns, first, weights)
    return first, weights


def variances(
    covariance: Float[np.ndarray, "n band"], x: Float[np.ndarray, "m 2"], rows: int, columns: int
) -> Float[np.ndarray, "m"]:
    """Variance of the value at each place, from the coefficients' covariance within the band."""
    first, weights = first_numbers(x, rows, columns)
    result = np.empty(len(x))
    _variances(covariance, first, weights, columns, result)
    return result


@kernel
def add_normal_equations(
    first, weights, precision, target, columns, matrix, right_side
):  # shapes: n, n 16, n, n, -, size band, size
    """Add to a banded matrix and its right side what observations say, each a value at a place
    that has a weight.
    """
    for i in range(first.size):
        for k in range(16):
            row = first[i] + (k // 4) * columns + k % 4
            share = precision[i] * weights[i, k]
            right_side[row] += share * target[i]
            for m in range(k, 16):
                column = first[i] + (m // 4) * columns + m % 4
                matrix[row, column - row] += share * weights[i, m]


@kernel
def _basis(t, value, slope, bend):
    """Weights of four neighbouring coefficients at t in [0, 1), and their derivatives."""
    s = 1.0 - t
    value[0] = s * s * s / 6.0
    value[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    value[2] = (3.0 * (t + t * t - t * t * t) + 1.0) / 6.0
    value[3] = t * t * t / 6.0
    slope[0] = -s * s / 2.0
    slope[1] = (3.0 * t * t - 4.0 * t) / 2.0
    slope[2] = (1.0 + 2.0 * t - 3.0 * t * t) / 2.0
    slope[3] = t * t / 2.0
    bend[0] = s
    bend[1] = 3.0 * t - 2.0
    bend[2] = 1.0 - 3.0 * t
    bend[3] = t


@kernel
def value(coefficients, x, y):
    """The value at one place, in units of the spacing."""
    i = int(min(max(np.floor(x), 0), coefficients.shape[0] - 4))
    j = int(min(max(np.floor(y), 0), coefficients.shape[1] - 4))
    t = x - i
    u = y - j
    b0 = (1.0 - u) ** 3 / 6.0
    b1 = (3.0 * u**3 - 6.0 * u * u + 4.0) / 6.0
    b2 = (3.0 * (u + u * u - u**3) + 1.0) / 6.0
    b3 = u**3 / 6.0
    total = 0.0
    for k in range(4):
        if k == 0:
            a = (1.0 - t) ** 3 / 6.0
        elif k == 1:
            a = (3.0 * t**3 - 6.0 * t * t + 4.0) / 6.0
        elif k == 2:
            a = (3.0 * (t + t * t - t**3) + 1.0) / 6.0
        else:
            a = t**3 / 6.0
        c = coefficients[i + k]
        total += a * (b0 * c[j] + b1 * c[j + 1] + b2 * c[j + 2] + b3 * c[j + 3])
    return total


@kernel
def _values(coefficients, x, result):
    cells = (coefficients.shape[0] - 4, coefficients.shape[1] - 4)
    down = np.empty((3, 4))
    across = np.empty((3, 4))
    for n in range(x.shape[0]):
        i = int(min(max(np.floor(x[n, 0]), 0), cells[0]))
        j = int(min(max(np.floor(x[n, 1]), 0), cells[1]))
        _basis(x[n, 0] - i, down[0], down[1], down[2])
        _basis(x[n, 1] - j, across[0], across[1], across[2])
        result[n] = 0.0
        for k in range(4):
            for m in range(4):
                c = coefficients[i + k, j + m]
                result[n, 0] += c * down[0, k] * across[0, m]
                result[n, 1] += c * down[1, k] * across[0, m]
                result[n, 2] += c * down[0, k] * across[1, m]
                result[n, 3] += c * down[2, k] * across[0, m]
                result[n, 4] += c * down[1, k] * across[1, m]
                result[n, 5] += c * down[0, k] * across[2, m]


@kernel
def _first_numbers(x, rows, columns, first, weights):
    down = np.empty((3, 4))
    across = np.empty((3, 4))
    for n in range(x.shape[0]):
        i = int(min(max(np.floor(x[n, 0]), 0), rows - 4))
        j = int(min(max(np.floor(x[n, 1]), 0), columns - 4))
        _basis(x[n, 0] - i, down[0], down[1], down[2])
        _basis(x[n, 1] - j, across[0], across[1], across[2])
        first[n] = i * columns + j
        for k in range(4):
            for m in range(4):
                weights[n, 4 * k + m] = down[0, k] * across[0, m]


@kernel
def _variances(covariance, first, weights, columns, result):
    for n in range(first.size):
        total = 0.0
        for k in range(16):
            row = first[n] + (k // 4) * columns + k % 4
            total += weights[n, k] ** 2 * covariance[row, 0]
            for m in range(k + 1, 16):
                column = first[n] + (m // 4) * columns + m % 4
                total += 2.0 * weights[n, k] * weights[n, m] * covariance[row, column - row]
        result[n] = total
