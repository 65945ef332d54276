"""A bicubic B-spline field over an image region, and the banded normal equations of fits to it.

The region is tiled by square cells. All pixels of a cell depend on the same 16 coefficients,
through weights that are the same in every cell: evaluating the field and summing normal equations
are products with one small matrix.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import sparse

from breastscan.geometry import bicubic
from breastscan.geometry.banded import inverse_within_band, product


@dataclass(frozen=True, kw_only=True)
class SplineField:
    """`rows` x `columns` cells of `spacing` x `spacing` pixels; coefficients are numbered row by
    row.
    """

    rows: int
    columns: int
    spacing: int
    """Distance of the knots [px]."""

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return (self.rows + 3) * (self.columns + 3)

    @property
    def bandwidth(self) -> int:
        """Largest distance of two coefficients that one pixel depends on."""
        return bicubic.bandwidth(self.columns + 3)

    @cached_property
    def weights(self) -> Float[np.ndarray, "pixels 16"]:
        """Weight of each of a cell's coefficients at each of its pixels."""
        t = (np.arange(self.spacing) + 0.5) / self.spacing
        along = (
            np.stack(
                [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 3 * (t + t**2 - t**3) + 1, t**3], axis=-1
            )
            / 6
        )
        return np.einsum("yi,xj->yxij", along, along).reshape(-1, 16)

    @cached_property
    def coefficients_of(self) -> Int[np.ndarray, "cells 16"]:
        """Numbers of the coefficients that each cell depends on."""
        stride = self.columns + 3
        corner = (np.arange(self.rows)[:, None] * stride + np.arange(self.columns)).reshape(-1, 1)
        return corner + (np.arange(4)[:, None] * stride + np.arange(4)).reshape(-1)

    def evaluate(self, coefficients: Float[np.ndarray, "n"]) -> Float[np.ndarray, "cells pixels"]:
        """The field at every pixel."""
        return product(coefficients[self.coefficients_of], np.ascontiguousarray(self.weights.T))

    def right_side(self, values: Float[np.ndarray, "cells pixels"]) -> Float[np.ndarray, "n"]:
        """The sum over pixels of value times weights."""
        sums = product(values, self.weights)
        return np.bincount(self.coefficients_of.ravel(), weights=sums.ravel(), minlength=self.size)

    def normal_matrix(
        self, values: Float[np.ndarray, "cells pixels"]
    ) -> Float[np.ndarray, "n band"]:
        """The sum over pixels of value times the products of weights, banded as `banded.py` has
        it.
        """
        sums = product(values, self._weight_products)
        band = np.bincount(
            self._band_position.ravel(), weights=sums.ravel(), minlength=self._band_size
        )
        return band.reshape(self.size, self.bandwidth + 1)

    def variance(self, factor: Float[np.ndarray, "n band"]) -> Float[np.ndarray, "cells pixels"]:
        """Variance of the field at every pixel; its coefficients' covariance is (U^T U)^-1 of
        the banded `factor` U.
        """
        covariance = inverse_within_band(factor)
        i, j = np.tril_indices(16)
        occurrences = np.where(i == j, 1.0, 2.0)  # below and above the diagonal
        of_cells = covariance.ravel()[self._band_position] * occurrences
        return product(of_cells, np.ascontiguousarray(self._weight_products.T))

    @cached_property
    def bending(self) -> sparse.csr_array:
        """Matrix of the sum of squared third differences of the coefficients: locally quadratic
        domes cost nothing.
        """
        return bicubic.bending(self.rows + 3, self.columns + 3)

    @cached_property
    def banded_bending(self) -> Float[np.ndarray, "n band"]:
        """The same in the form that `banded.py` takes."""
        return bicubic.banded(self.bending, self.bandwidth)

    def to_cells(self, region: Shaped[np.ndarray, "h w"]) -> Shaped[np.ndarray, "cells pixels"]:
        """The region's pixels, cell by cell."""
        s = self.spacing
        return region.reshape(self.rows, s, self.columns, s).swapaxes(1, 2).reshape(-1, s * s)

    def to_region(self, cells: Shaped[np.ndarray, "cells pixels"]) -> Shaped[np.ndarray, "h w"]:
        """The inverse of `to_cells`."""
        s = self.spacing
        return (
            cells.reshape(self.rows, self.columns, s, s)
            .swapaxes(1, 2)
            .reshape(self.rows * s, self.columns * s)
        )

    @cached_property
    def _weight_products(self) -> Float[np.ndarray, "pixels 136"]:
        """Products of each two of a cell's weights, the lower triangle."""
        i, j = np.tril_indices(16)
        return np.ascontiguousarray(self.weights[:, i] * self.weights[:, j])

    @cached_property
    def _band_position(self) -> Int[np.ndarray, "cells 136"]:
        """Where in the flattened banded form those products belong."""
        i, j = np.tril_indices(16)
        row, column = self.coefficients_of[:, i], self.coefficients_of[:, j]
        return column * (self.bandwidth + 1) + row - column

    @property
    def _band_size(self) -> int:
        return (self.bandwidth + 1) * self.size


@dataclass(frozen=True, kw_only=True)
class Region:
    """The part of the image that the field covers; it may reach beyond the right and lower
    borders.
    """

    top: int
    """First row [px]."""
    left: int
    """First column [px]."""
    field: SplineField

    @staticmethod
    def around(mask: Bool[np.ndarray, "h w"], spacing: int) -> "Region":
        """The smallest region of whole cells that holds the mask."""
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        cells = [int(-(-(side[-1] + 1 - side[0]) // spacing)) for side in (rows, columns)]
        field = SplineField(rows=cells[0], columns=cells[1], spacing=spacing)
        return Region(top=int(rows[0]), left=int(columns[0]), field=field)

    @property
    def rows(self) -> slice:
        """Rows of the image."""
        return slice(self.top, self.top + self.field.rows * self.field.spacing)

    @property
    def columns(self) -> slice:
        """Columns of the image."""
        return slice(self.left, self.left + self.field.columns * self.field.spacing)

    def cut(
        self, image: Shaped[np.ndarray, "h w"], fill: float | bool
    ) -> Shaped[np.ndarray, "rows columns"]:
        """The region's pixels, `fill` beyond the image's border."""
        part = image[self.rows, self.columns]
        whole = (self.rows.stop - self.rows.start, self.columns.stop - self.columns.start)
        missing = [(0, size - have) for size, have in zip(whole, part.shape, strict=True)]
        return np.pad(part, missing, constant_values=fill)

    def pasted(
        self, cells: Shaped[np.ndarray, "cells pixels"], image: Shaped[np.ndarray, "h w"]
    ) -> Shaped[np.ndarray, "h w"]:
        """A copy of `image` with the region's pixels replaced."""
        result = image.copy()
        part = result[self.rows, self.columns]
        part[:] = self.field.to_region(cells)[: part.shape[0], : part.shape[1]]
        return result
