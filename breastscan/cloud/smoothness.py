"""How smooth a skin is, learned from it place by place.

Third differences of a spline's coefficients are taken as normal about zero, with a variance that
changes slowly over the chart. It is what makes the sightings most likely (MacKay's fixed point
[MacKay 1992], pooled over a neighbourhood): small on the flank, where noise then averages
out, and large on a nipple, a wart or a fold, which are left standing.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from breastscan.geometry import bicubic
from breastscan.geometry.compiled import kernel

FIRST_SPREAD = 3e-4
"""Standard deviation of a third difference before anything is learned [m]: of a skin between the
dome and the nipple."""
USUAL_SPREAD = 2e-4
"""What is expected of it before it is learned how smooth a place is [m]."""
USUAL = 0.1
"""How many coefficients of those that sightings tell this counts as. With next to none (.001) noise
is taken for shape here and there, and smooth places for smoother than they are: of sixteen breasts
of the population normals are then off by 1.27 degrees instead of 1.15, their worst twentieth by 3.6
instead of 3.2, halfway up by .78 instead of .62 (medians)."""
POOL = 1.75
"""Reach of the pooling [cells of the grid], a standard deviation."""
LEAST_VARIANCE, GREATEST_VARIANCE = 1e-12, 1e-4
"""Of a third difference [m^2]."""


@dataclass(frozen=True, kw_only=True)
class Smoothness:
    """What is expected of the third differences of a grid's coefficients."""

    variance: Float[np.ndarray, "m m"]
    """Of those that begin at each coefficient [m^2]."""

    @staticmethod
    def unknown(size: int) -> "Smoothness":
        """The same everywhere, for a grid of `size` by `size` coefficients."""
        return Smoothness(variance=np.full((size, size), FIRST_SPREAD**2))

    def add_to(self, matrix: Float[np.ndarray, "n band"]) -> None:
        """Add what is expected to banded normal equations."""
        _add(1.0 / self.variance, *_STENCILS, matrix)

    def learned(
        self,
        radii: Float[np.ndarray, "m m"],
        covariance: Float[np.ndarray, "n band"],
        least: Float[np.ndarray, "m m"],
    ) -> "Smoothness":
        """What a fit with this expectation teaches.

        Args:
            radii: Its coefficients [m].
            covariance: Theirs, within the band [m^2].
            least: What the variances are known to be at least [m^2].
        """
        squares, uncertainty = np.zeros_like(radii), np.zeros_like(radii)
        _third_differences(radii, covariance, *_STENCILS, squares, uncertainty)
        # of each coefficient, the share that sightings tell and not what was expected
        seen = np.where(uncertainty > 0, np.maximum(1.0 - uncertainty / self.variance, 0.0), 0.0)
        variance = (gaussian_filter(squares, POOL) + USUAL * USUAL_SPREAD**2) / (
            gaussian_filter(seen, POOL) + USUAL
        )
        variance = np.clip(variance, LEAST_VARIANCE, GREATEST_VARIANCE)
        return Smoothness(variance=np.maximum(variance, least))


def _stencils() -> tuple[
    Int[np.ndarray, "4 8"], Int[np.ndarray, "4 8"], Float[np.ndarray, "4 8"], Int[np.ndarray, "4 3"]
]:
    """Of each kind of third difference: rows, columns and weights of its terms; how many they are,
    its order along the rows, and the square root of how often it counts is in the weights.
    """
    along = [np.array([1.0]), np.array([-1.0, 1.0]), np.array([1.0, -2.0, 1.0])]
    along.append(np.array([-1.0, 3.0, -3.0, 1.0]))
    rows, columns = np.zeros((4, 8), int), np.zeros((4, 8), int)
    weights, shapes = np.zeros((4, 8)), np.zeros((4, 3), int)
    for kind, (order, multiplicity) in enumerate(bicubic.THIRD_DIFFERENCES):
        products = np.sqrt(multiplicity) * np.outer(along[order], along[3 - order])
        count = products.size
        rows[kind, :count], columns[kind, :count] = np.indices(products.shape).reshape(2, -1)
        weights[kind, :count] = products.ravel()
        shapes[kind] = count, order, 3 - order
    return rows, columns, weights, shapes


_STENCILS = _stencils()


@kernel
def _add(stiffness, rows, columns, weights, shapes, matrix):
    size = stiffness.shape[0]
    for kind in range(shapes.shape[0]):
        count = shapes[kind, 0]
        for i in range(size - shapes[kind, 1]):
            for j in range(size - shapes[kind, 2]):
                for k in range(count):
                    first = (i + rows[kind, k]) * size + j + columns[kind, k]
                    share = stiffness[i, j] * weights[kind, k]
                    for m in range(k, count):
                        second = (i + rows[kind, m]) * size + j + columns[kind, m]
                        matrix[first, second - first] += share * weights[kind, m]


@kernel
def _third_differences(radii, covariance, rows, columns, weights, shapes, squares, uncertainty):
    size = radii.shape[0]
    for kind in range(shapes.shape[0]):
        count = shapes[kind, 0]
        for i in range(size - shapes[kind, 1]):
            for j in range(size - shapes[kind, 2]):
                difference = 0.0
                for k in range(count):
                    row = i + rows[kind, k]
                    column = j + columns[kind, k]
                    first = row * size + column
                    weight = weights[kind, k]
                    difference += weight * radii[row, column]
                    uncertainty[i, j] += weight * weight * covariance[first, 0]
                    for m in range(k + 1, count):
                        second = (i + rows[kind, m]) * size + j + columns[kind, m]
                        uncertainty[i, j] += (
                            2.0 * weight * weights[kind, m] * covariance[first, second - first]
                        )
                squares[i, j] += difference * difference
