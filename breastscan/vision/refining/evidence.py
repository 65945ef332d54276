"""What a rectified pair says about the disparity of each single pixel, near one that is known well.

Every pixel is one measurement: how far its grey level is from the right image's at x - d, and how
that changes with d, both in standard deviations. Shading that differs between the views and noise
that differs from place to place are found from the neighbourhood.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Shaped
from scipy.ndimage import spline_filter1d

from breastscan.vision.camera import RectifiedPair
from breastscan.vision.refining.photometric import (
    MIN_NOISE,
    FitConfig,
    cauchy_weight,
    evaluate_rows,
    line_fit,
    noise_of,
)
from breastscan.vision.refining.row_shift import RowShift

GAIN_ROUNDS = 3
"""Fits of the cameras' gain, outliers counting less in each."""
SHADING_PX = 8.0
"""Reach of the neighbourhood that tells how shading differs between the views [px]."""
NOISE_PX = 6.0
"""Reach of that which tells the noise: on a flank seen at a grazing angle it is three times that
of the top [px]."""
LARGEST_RESIDUAL = 4.0
"""A greater residual counts as this towards the noise [standard deviations]."""
ABSOLUTE_DEVIATIONS = 1.2533
"""Standard deviations of a normal distribution in its mean absolute value."""
NEIGHBOURS = 2.0
"""Pixels that share one measurement's noise, by the interpolation of rectified images: their
residuals times slopes are correlated by .10 to .13 with each of four neighbours."""
RIM_VARIANCE, RIM_PX = 1.0, 1.5
"""Variance that a pixel at the rim of the known has in addition [times the noise's], and over which
distance that fades: what lies behind shines into it."""


@dataclass(frozen=True, kw_only=True)
class PixelEvidence:
    """Of each pixel whose disparity was given, row by row."""

    residual: Float[np.ndarray, "n"]
    """Left less right grey level [standard deviations]."""
    slope: Float[np.ndarray, "n"]
    """Its change with the disparity [1/px]."""


@dataclass(frozen=True, kw_only=True)
class Photometry:
    """A pair made ready to be asked at any disparity."""

    left: Float[np.ndarray, "h w"]
    right_splines: Float[np.ndarray, "h w"]
    """The right image, its rows put right, as cubic splines along them."""

    @staticmethod
    def of(pair: RectifiedPair, shift: RowShift) -> "Photometry":
        """That of a pair whose rows are off by `shift`."""
        right = shift.undone(pair.right, slice(0, len(pair.right))).astype(float)
        return Photometry(
            left=pair.left.astype(float),
            right_splines=spline_filter1d(right, 3, axis=1, mode="mirror"),
        )

    def at(self, disparity: Shaped[np.ndarray, "h w"]) -> PixelEvidence:
        """What each pixel says whose disparity is finite [px]."""
        known = np.isfinite(disparity)
        rows, columns = np.nonzero(known)
        right, slope = (np.empty((1, len(rows))) for _ in range(2))
        evaluate_rows(
            self.right_splines,
            rows[None],
            columns[None],
            disparity[known][None].astype(float),
            right,
            slope,
        )
        left = self.left[known]
        residual, gain, weight = _gained(left, right[0])
        slope = gain * slope[0]
        near = _Neighbourhood.of(known)
        total = np.maximum(near.sums(weight, SHADING_PX), np.finfo(float).tiny)
        residual = residual - near.sums(weight * residual, SHADING_PX) / total
        slope = slope - near.sums(weight * slope, SHADING_PX) / total
        clipped = np.minimum(np.abs(residual), LARGEST_RESIDUAL * noise_of(residual))
        noise = near.sums(clipped, NOISE_PX) / near.sums(np.ones(len(rows)), NOISE_PX)
        deviation = np.maximum(ABSOLUTE_DEVIATIONS * noise, MIN_NOISE)
        rim = RIM_VARIANCE * np.exp(-(near.from_rim - 1.0) / RIM_PX)
        deviation *= np.sqrt(NEIGHBOURS * (1.0 + rim))
        return PixelEvidence(residual=residual / deviation, slope=slope / deviation)


def _gained(
    left: Float[np.ndarray, "n"], right: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], float, Float[np.ndarray, "n"]]:
    """Left less gain times right less bias, the gain, and how far each residual is believed."""
    gain, bias = 1.0, 0.0
    weight = np.ones_like(left)
    for _ in range(GAIN_ROUNDS):
        residual = left - gain * right - bias
        weight = cauchy_weight(residual, FitConfig().robust_scale * noise_of(residual))
        gain, bias = line_fit(right, left, weight)
    return left - gain * right - bias, gain, weight


@dataclass(frozen=True, kw_only=True)
class _Neighbourhood:
    """Sums over what lies near each known pixel."""

    known: np.ndarray
    """The smallest part of the image that holds the known pixels."""

    @staticmethod
    def of(known: np.ndarray) -> "_Neighbourhood":
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        return _Neighbourhood(known=known[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1])

    def sums(self, values: Float[np.ndarray, "n"], reach_px: float) -> Float[np.ndarray, "n"]:
        """Of values at the known pixels, weighted by a bell of that reach."""
        image = np.zeros(self.known.shape)
        image[self.known] = values
        blurred = cv2.GaussianBlur(image, (0, 0), reach_px, borderType=cv2.BORDER_CONSTANT)
        return blurred[self.known]

    @property
    def from_rim(self) -> Float[np.ndarray, "n"]:
        """Distance of each known pixel from the nearest one that is not [px]."""
        padded = np.pad(self.known, 1).astype(np.uint8)
        distance = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
        return distance[self.known].astype(float)
