"""Whether a set of shots can be trusted with a calibration: small residuals alone do not say so."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError
from breastscan.vision.board import BoardShot

CELLS = (8, 6)
"""Columns and rows of the cells in which corners are counted."""
MIN_COVERAGE = 0.5
"""Fraction of each image's cells with a corner in it [-]."""
MIN_TILT_SPREAD = np.radians(8.0)
"""Spread of the boards' normals about every axis, one sigma [rad]."""
LARGEST_HELD_OUT_RATIO = 2.0
"""Residual of shots held out over that of the fit [-]."""
LARGEST_FIT_PX = 0.5
"""Residual of the fit [px]."""


@dataclass(frozen=True, kw_only=True)
class Quality:
    """What speaks for a calibration."""

    coverage: tuple[float, float]
    """Fraction of the cells of the left and the right image with a corner in it [-]."""
    tilt_spread: float
    """Spread of the boards' normals about the axis where it is smallest, one sigma [rad]."""
    held_out_px: float
    """Residual of shots that a calibration from the others has not seen [px]."""
    fit_px: float
    """Residual of the fit [px]."""


def check(quality: Quality) -> None:
    """Refuse a set of shots that does not determine the cameras well.

    Raises:
        CalibrationError: The reason, and how to shoot better.
    """
    for side, fraction in zip(("left", "right"), quality.coverage, strict=True):
        if fraction < MIN_COVERAGE:
            raise CalibrationError(
                f"the board's corners cover {fraction:.0%} of the {side} image, {MIN_COVERAGE:.0%} "
                "are needed: show the board in the corners and along the edges too",
                quality,
            )
    if quality.tilt_spread < MIN_TILT_SPREAD:
        raise CalibrationError(
            f"the board's tilt varies by {np.degrees(quality.tilt_spread):.1f} deg about one axis, "
            f"{np.degrees(MIN_TILT_SPREAD):.0f} deg are needed: tilt it by 20 to 45 deg about "
            "several axes",
            quality,
        )
    if quality.fit_px > LARGEST_FIT_PX:
        raise CalibrationError(
            f"the corners depart from the fitted cameras by {quality.fit_px:.2f} px, at most "
            f"{LARGEST_FIT_PX} px are accepted: is the board flat, are its squares as stated, are "
            "the pictures sharp and taken together?",
            quality,
        )
    if quality.held_out_px > LARGEST_HELD_OUT_RATIO * quality.fit_px:
        raise CalibrationError(
            f"shots held out of the calibration depart by {quality.held_out_px:.3f} px, those in "
            f"it by {quality.fit_px:.3f} px: the shots do not determine the cameras, take more of "
            "them",
            quality,
        )


def image_coverage(shots: Sequence[BoardShot], size: tuple[int, int]) -> tuple[float, float]:
    """Fraction of the cells of the left and the right image in which a corner was found."""

    def fraction(side: str) -> float:
        pixels = np.vstack([getattr(shot, side) for shot in shots])
        counts, _, _ = np.histogram2d(*pixels.T, bins=CELLS, range=((0, size[0]), (0, size[1])))
        return float((counts > 0).mean())

    return fraction("left"), fraction("right")


def tilt_spread(X_LBoard: Float[np.ndarray, "shots 4 4"]) -> float:
    """Spread of the boards' normals about the axis where it is smallest, one sigma [rad]."""
    normals_L = X_LBoard[:, :3, 2]
    variances = np.linalg.eigvalsh(np.cov(normals_L[:, :2].T))
    return float(np.arcsin(np.sqrt(np.clip(variances[0], 0.0, 1.0))))
