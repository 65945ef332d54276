"""How far the rows of a rectified pair are off, from the images themselves, and the right image put
on its rows.

Where a rig has moved since its calibration, a point no longer lies on the same row of both views. A
pitch, a roll and a change of focal length between the cameras are seen so: three parameters, found
by least squares on the grey levels where the disparity is known. A yaw is not: it looks like
another depth. (Not in the paper.)
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.ndimage import correlate1d

from breastscan.vision.refining.photometric import GreyLevels, cauchy_weight, line_fit, noise_of
from breastscan.vision.refining.spline_field import Region

SLOPE_TAPS = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
"""Derivative along y, exact for polynomials of the fourth degree."""
ROUNDS = 4
CONVERGED_PX = 0.005
SIGNIFICANT_PX, SIGNIFICANT_SIGMAS = 0.02, 4.0
"""A smaller shift, or one that is less certain, is none: to resample the image would cost more than
it mends."""
ROBUST_SCALE = 2.4
"""Scale of Cauchy's robust loss [standard deviations of the noise]: such a residual counts half."""
RIDGE = 1e-6


@dataclass(frozen=True, kw_only=True)
class RowShift:
    """The right image shows on row y + offset + along_x (x - x0) + along_y (y - y0) what belongs
    on row y [px].
    """

    offset: float = 0.0
    """[px]"""
    along_x: float = 0.0
    """Slope along the right image's rows: a roll [px/px]."""
    along_y: float = 0.0
    """Slope along its columns: another focal length [px/px]."""
    x0: float = 0.0
    """Centre of the object in the right image [px]."""
    y0: float = 0.0
    """[px]"""

    def at(
        self, x: Shaped[np.ndarray, "*n"], y: Shaped[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n"]:
        """The shift at pixels of the right image [px]."""
        return self.offset + self.along_x * (x - self.x0) + self.along_y * (y - self.y0)

    @property
    def is_seen(self) -> bool:
        """Whether there is any."""
        return bool(self.offset or self.along_x or self.along_y)

    def undone(self, right: Shaped[np.ndarray, "h w"], rows: slice) -> Shaped[np.ndarray, "h w"]:
        """The right image with its `rows` put where they belong; the image itself where nothing
        is off.
        """
        if not self.is_seen:
            return right
        height, width = right.shape
        y, x = np.mgrid[rows.start : min(rows.stop, height), 0:width].astype(np.float32)
        image = right.astype(np.float32)
        image[rows] = cv2.remap(
            image,
            x,
            y + self.at(x, y).astype(np.float32),
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return image


def row_shift(
    left: Shaped[np.ndarray, "h w"],
    right: Shaped[np.ndarray, "h w"],
    region: Region,
    disparity: Float[np.ndarray, "cells pixels"],
    inside: Bool[np.ndarray, "cells pixels"],
    shift: RowShift,
) -> RowShift:
    """The shift of the right image's rows over an object.

    Args:
        left: Rectified left image.
        right: Rectified right image.
        region: Where the object is.
        disparity: The object's, cell by cell [px].
        inside: Which pixels are the object.
        shift: What is known of it before.
    """
    for _ in range(ROUNDS):
        change, significant = _change(
            left, shift.undone(right, region.rows), region, disparity, inside
        )
        if not (significant or shift.is_seen):
            return shift
        shift = RowShift(
            offset=shift.offset + change.offset,
            along_x=shift.along_x + change.along_x,
            along_y=shift.along_y + change.along_y,
            x0=change.x0,
            y0=change.y0,
        )
        if abs(change.offset) < CONVERGED_PX:
            break
    return shift


def _change(
    left: Shaped[np.ndarray, "h w"],
    right: Shaped[np.ndarray, "h w"],
    region: Region,
    disparity: Float[np.ndarray, "cells pixels"],
    inside: Bool[np.ndarray, "cells pixels"],
) -> tuple[RowShift, bool]:
    """One Gauss-Newton step on left - gain * right(x - d, y + shift) - bias, and whether it
    stands out of the noise.
    """
    levels = GreyLevels.cut(left, right, region)
    slopes = replace(
        levels, right_splines=correlate1d(levels.right_splines, SLOPE_TAPS, axis=0, mode="nearest")
    )
    value, slope = levels.right_at(disparity)[0], slopes.right_at(disparity)[0]
    gain, bias = line_fit(value, levels.left, inside.astype(float))
    residual = (levels.left - gain * value - bias)[inside]
    noise = noise_of(residual)
    x, y = (levels.column - disparity)[inside], (levels.row + float(region.top))[inside]
    centre = x.mean(), y.mean()
    size = max(float(np.ptp(x)), float(np.ptp(y)), 1.0)
    design = (
        gain
        * slope[inside][:, None]
        * np.stack([np.ones_like(x), (x - centre[0]) / size, (y - centre[1]) / size], 1)
    )
    weighted = design * cauchy_weight(residual, ROBUST_SCALE * noise)[:, None]
    information = weighted.T @ design + RIDGE * np.eye(3)
    found = np.linalg.solve(information, weighted.T @ residual)
    sigma = noise * np.sqrt(np.diag(np.linalg.inv(information)))
    significant = bool(
        np.any(np.abs(found) > np.maximum(SIGNIFICANT_PX, SIGNIFICANT_SIGMAS * sigma))
    )
    shift = RowShift(
        offset=float(found[0]), along_x=float(found[1] / size), along_y=float(found[2] / size),
        x0=float(centre[0]), y0=float(centre[1]),
    )  # fmt: skip
    return shift, significant
