"""Whether a set of shots can be trusted with a calibration: small residuals alone do not say so."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError
from breastscan.vision.boards.board import BoardShot

CELLS = (8, 6)
"""Columns and rows of the cells in which corners are counted."""


@dataclass(frozen=True, kw_only=True)
class QualityLimits:
    """The poorest set that is accepted."""

    coverage: float = 0.5
    """Least share of each image's cells with a corner in it [-]."""
    tilt_spread: float = np.radians(8.0)
    """Least spread of the boards' normals about every axis, one sigma [rad]."""
    held_out_ratio: float = 2.0
    """Largest residual of shots held out over that of the fit [-]."""
    fit_px: float = 0.5
    """Largest residual of the fit [px]."""

    def __post_init__(self) -> None:
        if not 0 <= self.coverage <= 1:
            raise CalibrationError(f"coverage is a share in 0 .. 1, got {self.coverage}", self.coverage)
        for name in ("tilt_spread", "held_out_ratio", "fit_px"):
            if not getattr(self, name) >= 0:
                raise CalibrationError(f"{name} must not be negative, got {getattr(self, name)}", self)


@dataclass(frozen=True, kw_only=True)
class Quality:
    """What speaks for a calibration."""

    coverage: tuple[float, float]
    """Share of the cells of the left and the right image with a corner in it [-]."""
    tilt_spread: float
    """Spread of the boards' normals about the axis with the least of it, one sigma [rad]."""
    held_out_px: float
    """Residual of shots that a calibration from the others has not seen [px]."""
    fit_px: float
    """Residual of the fit [px]."""


def check(quality: Quality, limits: QualityLimits) -> None:
    """Refuse a set of shots that does not determine the cameras well.

    Raises:
        CalibrationError: The reason, and how to shoot better.
    """
    for side, share in zip(("left", "right"), quality.coverage, strict=True):
        if share < limits.coverage:
            raise CalibrationError(
                f"the board's corners cover {share:.0%} of the {side} image, {limits.coverage:.0%} are needed: "
                "show the board in the corners and along the edges too",
                quality,
            )
    if quality.tilt_spread < limits.tilt_spread:
        raise CalibrationError(
            f"the board's tilt varies by {np.degrees(quality.tilt_spread):.1f} deg about one axis, "
            f"{np.degrees(limits.tilt_spread):.0f} deg are needed: tilt it by 20 to 45 deg about several axes",
            quality,
        )
    if quality.fit_px > limits.fit_px:
        raise CalibrationError(
            f"the corners depart from the fitted cameras by {quality.fit_px:.2f} px, at most {limits.fit_px} px are "
            "accepted: is the board flat, are its squares as stated, are the pictures sharp and taken together?",
            quality,
        )
    if quality.held_out_px > limits.held_out_ratio * quality.fit_px:
        raise CalibrationError(
            f"shots held out of the calibration depart by {quality.held_out_px:.3f} px, those in it by "
            f"{quality.fit_px:.3f} px: the shots do not determine the cameras, take more of them",
            quality,
        )


def image_coverage(shots: Sequence[BoardShot], size: tuple[int, int]) -> tuple[float, float]:
    """Share of the cells of the left and the right image in which a corner was found."""
    left, right = (
        _coverage(np.vstack([getattr(shot, side) for shot in shots]), size) for side in ("left", "right")
    )  # fmt: skip
    return left, right


def tilt_spread(X_LBoard: Float[np.ndarray, "shots 4 4"]) -> float:
    """Spread of the boards' normals about the axis with the least of it, one sigma [rad]."""
    normals_L = X_LBoard[:, :3, 2]
    variances = np.linalg.eigvalsh(np.cov(normals_L[:, :2].T))
    return float(np.arcsin(np.sqrt(np.clip(variances[0], 0.0, 1.0))))


def _coverage(pixels: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> float:
    counts, _, _ = np.histogram2d(*pixels.T, bins=CELLS, range=((0, size[0]), (0, size[1])))
    return float((counts > 0).mean())
