"""Whether a set of shots can be trusted with a calibration: small residuals alone do not say so."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.checks import require_positive
from breastscan.vision.board import BoardShot

CELLS = (8, 6)
"""Columns and rows of the cells in which corners are counted."""


@dataclass(frozen=True, kw_only=True)
class QualityLimits:
    """What a set of shots has to reach to be trusted."""

    coverage: float = 0.5
    """Least fraction of each image's cells with a corner in it [-]."""
    tilt_spread_deg: float = 8.0
    """Least spread of the boards' normals about every axis, one sigma [deg]."""
    fit_px: float = 0.5
    """Largest residual of the fit [px]."""
    held_out_ratio: float = 2.0
    """Largest residual of shots held out, over that of the fit [-]."""

    def __post_init__(self) -> None:
        require_positive(self, "limits")


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


def complaints(quality: Quality, limits: QualityLimits) -> list[str]:
    """Why a set of shots does not determine the cameras well, and how to shoot better."""
    left, right = quality.coverage
    tilt_deg = np.degrees(quality.tilt_spread)
    return [
        reason
        for reason, applies in {
            f"the board's corners cover {left:.0%} of the left and {right:.0%} of the right image, "
            f"{limits.coverage:.0%} are needed: show the board in the corners and along the edges "
            "too": min(left, right) < limits.coverage,
            f"the board's tilt varies by {tilt_deg:.1f} deg about one axis, "
            f"{limits.tilt_spread_deg:g} deg are needed: tilt it by 20 to 45 deg about several "
            "axes": tilt_deg < limits.tilt_spread_deg,
            f"the corners depart from the fitted cameras by {quality.fit_px:.2f} px, at most "
            f"{limits.fit_px:g} px are accepted: is the board flat, are its squares as stated, are "
            "the pictures sharp and taken together?": quality.fit_px > limits.fit_px,
            f"shots held out of the calibration depart by {quality.held_out_px:.3f} px, those in "
            f"it by {quality.fit_px:.3f} px: the shots do not determine the cameras, take more of "
            "them": quality.held_out_px > limits.held_out_ratio * quality.fit_px,
        }.items()
        if applies
    ]


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
