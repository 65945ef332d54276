"""Photometric refinement of the disparity on one smooth object, to a fraction of a tenth of a
pixel.

A bicubic B-spline disparity field is fitted to the images themselves: where the field is right, the
left grey level equals the right one at x - d, up to the gain and bias between the cameras.
Gauss-Newton from the matcher's disparity, robust weights, and a penalty on third differences that
is scaled by the noise found in the images. Rows that do not match are put right first
(`row_shift`). (Not in the paper.)
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PerceptionError
from breastscan.vision.refining.photometric import (
    FitConfig,
    GreyLevels,
    PhotometricFit,
    fit_to_images,
    fit_to_matcher,
)
from breastscan.vision.refining.row_shift import RowShift, row_shift
from breastscan.vision.refining.spline_field import Region

SHIFT_ROUNDS = 4
SHIFT_CONVERGED_PX = 0.005
"""A smaller change of the rows' shift asks for no other fit [px]."""


@dataclass(frozen=True, kw_only=True)
class RefineConfig:
    """How flexible the field is and how far it is trusted."""

    spacing_px: int = 6
    """Distance of the field's knots [px]."""
    fit: FitConfig = field(default_factory=FitConfig)
    largest_change_px: float = 2.0
    """Where the field leaves the matcher's disparity by more, the matcher's stands [px]."""
    jump_px: float = 4.0
    """A larger step between neighbours is a depth discontinuity, left alone with what is near [px]:
    17 mm at 540 mm."""
    largest_sigma_px: float = 0.25
    """Where the field is less certain, for want of texture, the matcher's disparity stands [px]."""

    def __post_init__(self) -> None:
        require_positive(self, "perception.refine")
        if self.spacing_px < 2:
            raise ConfigError(
                f"perception.refine.spacing_px must be 2 or more, got {self.spacing_px}",
                self.spacing_px,
            )


@dataclass(frozen=True, kw_only=True)
class RefinedDisparity:
    """The disparity after refinement, and how good it is."""

    disparity: Float32[np.ndarray, "h w"]
    """The field where it was applied, the matcher's disparity elsewhere [px]."""
    sigma_px: Float32[np.ndarray, "h w"]
    """Standard deviation of the field, NaN where it was not applied [px]."""
    applied: Bool[np.ndarray, "h w"]
    """Where the field replaced the matcher's disparity or filled a hole of it."""
    noise: float
    """Standard deviation of the grey-level difference that the fit leaves [grey levels]."""
    row_shift: RowShift
    """How far the right image's rows were off, and were put right for the fit."""


def refine(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    disparity: Float32[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    config: RefineConfig | None = None,
) -> RefinedDisparity:
    """Refine `disparity` [px] inside `mask`, which must hold one smooth surface but for jumps that
    are left alone.

    Raises:
        PerceptionError: The mask holds no known disparity.
    """
    config = config or RefineConfig()
    smooth = mask & ~_near_jumps(np.where(mask, disparity, np.float32(np.nan)), config)
    if not np.isfinite(disparity[smooth]).any():
        raise PerceptionError(
            "expected a smooth object with known disparity to refine, found none among the mask's "
            f"{mask.sum()} px: match the pair first and give the mask that segment_breast found",
            int(mask.sum()),
        )
    region = Region.around(smooth, config.spacing_px)
    spline = region.field
    matched, inside = (
        spline.to_cells(region.cut(disparity, np.nan)),
        spline.to_cells(region.cut(smooth, False)),
    )
    fit, shift = _fit_on_its_rows(left, right, region, matched, inside, config.fit)
    refined = spline.evaluate(fit.coefficients)
    # the smoothing is taken as the field's prior
    sigma = np.sqrt(spline.variance(fit.factor / fit.noise))
    agrees = ~(np.abs(refined - matched) > config.largest_change_px)  # true in holes
    applied = inside & agrees & (sigma < config.largest_sigma_px)
    return RefinedDisparity(
        disparity=region.pasted(np.where(applied, refined, matched), disparity),
        sigma_px=region.pasted(np.where(applied, sigma, np.nan), np.full_like(disparity, np.nan)),
        applied=region.pasted(applied, np.zeros_like(mask)),
        noise=fit.noise,
        row_shift=shift,
    )


def _fit_on_its_rows(
    left: UInt8[np.ndarray, "h w"],
    right: UInt8[np.ndarray, "h w"],
    region: Region,
    matched: Float32[np.ndarray, "cells pixels"],
    inside: Bool[np.ndarray, "cells pixels"],
    config: FitConfig,
) -> tuple[PhotometricFit, RowShift]:
    """The field and the shift of the rows in turn: where rows do not match, neither is exact
    without the other.
    """
    spline = region.field

    def fitted(coefficients: Float[np.ndarray, "n"], shift: RowShift) -> PhotometricFit:
        images = GreyLevels.cut(left, shift.undone(right, region.rows), region)
        return fit_to_images(spline, images, inside, coefficients, config)

    def shifted(coefficients: Float[np.ndarray, "n"], shift: RowShift) -> RowShift:
        return row_shift(left, right, region, spline.evaluate(coefficients), inside, shift)

    start = fit_to_matcher(spline, matched, inside)
    shift = shifted(start, RowShift())
    fit = fitted(start, shift)
    for _ in range(SHIFT_ROUNDS if shift.is_seen else 0):
        before, shift = shift, shifted(fit.coefficients, shift)
        fit = fitted(fit.coefficients, shift)
        if abs(shift.offset - before.offset) < SHIFT_CONVERGED_PX:
            break
    return fit, shift


def _near_jumps(
    matched: Float32[np.ndarray, "h w"], config: RefineConfig
) -> Bool[np.ndarray, "h w"]:
    """Pixels within a knot of a depth discontinuity."""
    jumps = np.zeros(matched.shape, np.uint8)
    jumps[:, 1:] |= np.abs(np.diff(matched, axis=1)) > config.jump_px
    jumps[1:] |= np.abs(np.diff(matched, axis=0)) > config.jump_px
    return cv2.dilate(jumps, np.ones((2 * config.spacing_px + 1,) * 2, np.uint8)) > 0
