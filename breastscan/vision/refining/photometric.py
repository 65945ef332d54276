"""Fits of a spline disparity field: to the matcher's disparity, and from there to the images
themselves.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped
from scipy.ndimage import spline_filter1d

from breastscan.checks import require_positive
from breastscan.geometry import robust
from breastscan.geometry.banded import factorized, solved
from breastscan.geometry.compiled import kernel
from breastscan.vision.refining.spline_field import Region, SplineField

RIDGE = 1e-9
"""Added to the diagonal, so that a coefficient that no pixel sees stays where it is."""
INITIAL_SMOOTHING = 1e-2
INITIAL_ROUNDS = 2
INITIAL_OUTLIER_PX = 0.3
"""In the fit to the matcher's disparity, a residual beyond this counts less."""
RENEWED_ABOVE_PX = 0.02
"""After a shorter step, RMS over the object, the normal matrix is kept [px]."""
MIN_NOISE = 0.3
"""Grey levels of noise that rounding to 8 bit leaves in any image."""


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """How the field is fitted to the images."""

    smoothing: float = 7.0
    """Penalty on squared third differences of the coefficients, times the noise variance
    [1/px^2]."""
    robust_scale: float = 2.4
    """Scale of the robust loss [standard deviations of the noise]: such a residual counts half
    (Cauchy's weight, 95 % efficient under normal noise): occluded pixels at the object's rim must
    not pull."""
    iterations: int = 8
    """Gauss-Newton steps at most."""
    converged_px: float = 1e-3
    """A step smaller than this, RMS over the object, ends the iteration [px]."""

    def __post_init__(self) -> None:
        require_positive(self, "perception.refine.fit")


@dataclass(frozen=True, kw_only=True)
class GreyLevels:
    """Grey levels of the region's left pixels, and the right image as cubic splines along its
    rows.
    """

    left: Float[np.ndarray, "cells pixels"]
    right_splines: Float[np.ndarray, "rows w"]
    row: Int[np.ndarray, "cells pixels"]
    """Row of each pixel in `right_splines`."""
    column: Int[np.ndarray, "cells pixels"]
    """Column of each pixel in the whole image."""

    @staticmethod
    def cut(
        left: Shaped[np.ndarray, "h w"], right: Shaped[np.ndarray, "h w"], region: Region
    ) -> "GreyLevels":
        """Those that the region needs."""
        rows, columns = np.mgrid[region.rows, region.columns]
        splines = spline_filter1d(right[region.rows].astype(float), 3, axis=1, mode="mirror")
        return GreyLevels(
            left=region.field.to_cells(region.cut(left, 0.0)).astype(float),
            right_splines=splines,
            row=region.field.to_cells(np.minimum(rows - region.top, len(splines) - 1)),
            column=region.field.to_cells(columns),
        )

    def right_at(
        self, disparity: Float[np.ndarray, "cells pixels"]
    ) -> tuple[Float[np.ndarray, "cells pixels"], Float[np.ndarray, "cells pixels"]]:
        """Right grey level at x - d and its slope along x; beyond the border that of the border,
        with no slope.
        """
        value, slope = np.empty_like(disparity), np.empty_like(disparity)
        evaluate_rows(self.right_splines, self.row, self.column, disparity, value, slope)
        return value, slope


@kernel
def evaluate_rows(splines, row, column, disparity, value, slope):
    """Cubic B-splines along rows, at column - disparity; compiled, since NumPy's temporaries
    cost ten times as much.
    """
    last = splines.shape[1] - 2.001
    for i in range(disparity.shape[0]):
        for k in range(disparity.shape[1]):
            exact = column[i, k] - disparity[i, k]
            position = min(max(exact, 1.0), last)
            knot = int(position)
            t = position - knot
            c0, c1 = splines[row[i, k], knot - 1], splines[row[i, k], knot]
            c2, c3 = splines[row[i, k], knot + 1], splines[row[i, k], knot + 2]
            value[i, k] = (
                (1 - t) ** 3 * c0
                + (3 * t**3 - 6 * t**2 + 4) * c1
                + (3 * (t + t**2 - t**3) + 1) * c2
                + t**3 * c3
            ) / 6
            along = (
                -((1 - t) ** 2) * c0
                + (3 * t**2 - 4 * t) * c1
                + (1 + 2 * t - 3 * t**2) * c2
                + t**2 * c3
            ) / 2
            slope[i, k] = along if position == exact else 0.0


@dataclass(frozen=True, kw_only=True)
class PhotometricFit:
    """A field, how the grey levels of the cameras relate, and the noise that is left."""

    coefficients: Float[np.ndarray, "n"]
    """The field's [px]."""
    factor: Float[np.ndarray, "n band"]
    """Banded U with U^T U the normal matrix that the coefficients come from [1/px^2, times the
    noise variance]."""
    gain: float = 1.0
    bias: float = 0.0
    noise: float = MIN_NOISE
    """Standard deviation of left - gain * right(x - d) - bias [grey levels]."""


def fit_to_matcher(
    field: SplineField,
    matched: Float32[np.ndarray, "cells pixels"],
    smooth: Bool[np.ndarray, "cells pixels"],
) -> Float[np.ndarray, "n"]:
    """Coefficients of the field that best follows the matcher's disparity, outliers counting
    little.
    """
    known = smooth & np.isfinite(matched)
    target = np.where(known, matched, 0.0)
    smoothing = INITIAL_SMOOTHING * field.banded_bending + _ridge(field)
    coefficients, weight = np.zeros(field.size), known.astype(float)
    for _ in range(INITIAL_ROUNDS):
        factor = factorized(field.normal_matrix(weight) + smoothing)
        coefficients = solved(factor, field.right_side(weight * target))
        weight = known * cauchy_weight(target - field.evaluate(coefficients), INITIAL_OUTLIER_PX)
    return coefficients


def fit_to_images(
    field: SplineField,
    images: GreyLevels,
    smooth: Bool[np.ndarray, "cells pixels"],
    coefficients: Float[np.ndarray, "n"],
    config: FitConfig,
) -> PhotometricFit:
    """Gauss-Newton from `coefficients` until a step is small.

    The normal matrix hardly changes once the steps are short, and is then kept: to factorize it is
    most of the work.
    """
    fit, step_px = PhotometricFit(coefficients=coefficients, factor=field.banded_bending), np.inf
    for _ in range(config.iterations):
        before, fit = (
            fit,
            _step(field, images, smooth, fit, config, renew=step_px > RENEWED_ABOVE_PX),
        )
        step_px = float(
            np.sqrt(np.mean(field.evaluate(fit.coefficients - before.coefficients)[smooth] ** 2))
        )
        if step_px < config.converged_px:
            break
    return fit


def _step(
    field: SplineField,
    images: GreyLevels,
    smooth: Bool[np.ndarray, "cells pixels"],
    fit: PhotometricFit,
    config: FitConfig,
    *,
    renew: bool,
) -> PhotometricFit:
    """One Gauss-Newton step on left - gain * right(x - d) - bias, with the smoothing scaled by
    the noise.
    """
    right, slope = images.right_at(field.evaluate(fit.coefficients))
    residual = images.left - fit.gain * right - fit.bias
    noise = noise_of(residual[smooth])
    weight = smooth * cauchy_weight(residual, config.robust_scale * noise)
    derivative = fit.gain * slope  # of the residual by d
    smoothing = config.smoothing * noise**2
    factor = fit.factor
    if renew:
        factor = factorized(
            field.normal_matrix(weight * derivative**2)
            + smoothing * field.banded_bending
            + _ridge(field)
        )
    descent = -field.right_side(weight * derivative * residual) - smoothing * (
        field.bending @ fit.coefficients
    )
    gain, bias = line_fit(right, images.left, weight)
    coefficients = fit.coefficients + solved(factor, descent)
    return PhotometricFit(
        coefficients=coefficients, factor=factor, gain=gain, bias=bias, noise=noise
    )


def noise_of(residual: Float[np.ndarray, "n"]) -> float:
    """Standard deviation of grey-level differences, most of which are noise [grey levels]."""
    return max(MIN_NOISE, robust.deviation(residual))


def _ridge(field: SplineField) -> Float[np.ndarray, "band"]:
    """A banded row that adds `RIDGE` to the diagonal."""
    return RIDGE * np.eye(1, field.bandwidth + 1)[0]


def cauchy_weight(residual: Float[np.ndarray, "*s"], half: float) -> Float[np.ndarray, "*s"]:
    """Weight of each residual in a robust least squares; one as large as `half` counts half."""
    return 1.0 / (1.0 + (residual / half) ** 2)


def line_fit(
    x: Float[np.ndarray, "*s"], y: Float[np.ndarray, "*s"], weight: Float[np.ndarray, "*s"]
) -> tuple[float, float]:
    """Slope and intercept of the weighted least-squares line; slope 1 where x does not vary."""
    total = weight.sum()
    mean_x, mean_y = (weight * x).sum() / total, (weight * y).sum() / total
    spread = (weight * (x - mean_x) ** 2).sum()
    slope = (weight * (x - mean_x) * (y - mean_y)).sum() / spread if spread > 0 else 1.0
    return float(slope), float(mean_y - slope * mean_x)
