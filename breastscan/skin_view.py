"""The skin in a rectified pair: fitted to the images themselves, each pixel of the left view a
measurement of it.

The refined disparity only says where to begin. From there each pass asks the pair what it says at
the disparity that the skin makes expected, at every pixel that would see it: the refinement's own
smoothing leaves no trace.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from breastscan.cloud.segment import CROSS, LOWEST, Breast
from breastscan.cloud.skin_fit import Sightings, chart_pose, fit_skin, require_enough, support
from breastscan.geometry.skin import Skin
from breastscan.vision.camera import RectifiedPair
from breastscan.vision.refine import RefinedDisparity
from breastscan.vision.refining.evidence import Photometry

PASSES = 2
"""Fits after the first, which learn of the rim and of what the refinement left out."""
RIM_PX = 2
"""Pixels at the rim of the mask that the first fit leaves out: the matcher rounds off the foot."""
RIGHT_RIM_PX = 0.5
"""Distance from the skin's end in a row of the right view within which it is not asked [px]: what
lies behind shines in, and makes the skin seem .3 px farther."""
MARGIN_PX = 8
"""How far beyond the mask skin is looked for [px]."""
OTHER_ERRORS = 1.3
"""Variance of the skin over that by the noise alone [-]: what rectification, and at grazing angles
the pixels' own size, add to it; from seeds 0 and 2 and one breast of each class."""
NIPPLE_SPREAD = 12e-3
"""Of third differences on the top [m], `fit_skin`'s `nipple`: a hundred pixels see the nipple, and
without this its tip was .2 to .9 mm low. Those of true ones are up to 6 mm."""
GROWTH = 2
"""Squares of the chart by which a pass may go beyond what was seen before: where the flank turns
out of sight, the skin below it is a mere guess, and what its pixels see is the chest."""
HEADROOM = 0.005
"""How far before the point that was matched a ray begins to look for the skin [of its depth]."""
LARGEST_CHANGE_PX = 4.0
"""Where the matcher is farther from the skin, it saw something else [px]: 17 mm at 540 mm."""


def see_skin(
    pair: RectifiedPair, refined: RefinedDisparity, breast: Breast
) -> tuple[Skin, Float[np.ndarray, "h w"]]:
    """The breast's skin in L, and the disparity at which each pixel sees it [px]: NaN where it sees
    none, or the right camera does not see it too.

    Raises:
        PerceptionError: Hardly anything of it is seen.
    """
    inner = _grown(breast.mask, -RIM_PX)
    near = _grown(breast.mask, MARGIN_PX)
    seen = np.where(refined.applied & inner, refined.disparity.astype(float), np.nan)
    require_enough(int(np.count_nonzero(np.isfinite(seen))))
    X_LN = chart_pose(points(seen, pair), breast.plate)
    photometry = Photometry.of(pair, refined.row_shift)
    fit = fit_skin(_sightings(photometry, seen, pair), X_LN, None, NIPPLE_SPREAD)
    for _ in range(PASSES):
        seen = _disparity(fit.skin, pair, near, refined, breast)
        told = _sightings(photometry, _off_right_rim(seen), pair)
        fit = fit_skin(told, X_LN, fit, NIPPLE_SPREAD)
        known = support(fit.skin.chart(points(seen, pair)))
        fit = replace(fit, skin=replace(fit.skin, support=known))
    skin = replace(fit.skin, covariance=OTHER_ERRORS * fit.skin.covariance)
    return skin, _disparity(skin, pair, near, refined, breast)


def points(disparity: Float[np.ndarray, "h w"], pair: RectifiedPair) -> Float[np.ndarray, "n 3"]:
    """What the pixels see whose disparity is finite, row by row, in L [m]."""
    rows, columns = np.nonzero(np.isfinite(disparity))
    cx, cy = pair.centre_px
    rays_V = np.column_stack([columns - cx, rows - cy, np.full(len(rows), pair.focal_px)])
    return rays_V * (pair.baseline / disparity[rows, columns])[:, None] @ pair.R_LV.T


def _grown(mask: Bool[np.ndarray, "h w"], by_px: int) -> Bool[np.ndarray, "h w"]:
    """A mask with so many pixels more around it, or less."""
    change = cv2.dilate if by_px > 0 else cv2.erode
    return change(mask.astype(np.uint8), np.ones((3, 3)), iterations=abs(by_px)) > 0


def _sightings(
    photometry: Photometry, disparity: Float[np.ndarray, "h w"], pair: RectifiedPair
) -> Sightings:
    """What the pair says at this disparity, as points that are off along their lines of sight."""
    known = np.isfinite(disparity)
    evidence = photometry.at(disparity)
    p_L = points(disparity, pair)
    distance = np.linalg.norm(p_L, axis=1)
    return Sightings(
        points=p_L,
        lines=p_L / distance[:, None],
        residual=evidence.residual,
        slope=-evidence.slope * disparity[known] / distance,
    )


def _disparity(
    skin: Skin,
    pair: RectifiedPair,
    near: Bool[np.ndarray, "h w"],
    refined: RefinedDisparity,
    breast: Breast,
) -> Float[np.ndarray, "h w"]:
    """At which each pixel of `near` sees the skin above the chest, if the right camera does too and
    the matcher found nothing else there.
    """
    unit = pair.focal_px * pair.baseline
    rays_L = points(np.where(near, unit, np.nan), pair)
    matched = refined.disparity[near].astype(float)
    start = np.where(np.isfinite(matched), (1 - HEADROOM) * unit / matched, 0.0)
    depth = skin.first_hits(np.zeros(3), rays_L, start)
    p_L = rays_L * depth[:, None]
    above = breast.plate.heights(p_L) > LOWEST
    squares = skin.support.astype(np.uint8)
    grown = replace(skin, support=cv2.dilate(squares, CROSS, iterations=GROWTH) > 0)
    above[above] = grown.known(skin.chart(p_L[above]))
    agrees = ~(np.abs(matched - unit / depth) > LARGEST_CHANGE_PX)
    result = np.full(near.shape, np.nan)
    result[near] = np.where(above & agrees, unit / depth, np.nan)
    rows = np.flatnonzero(near.any(axis=1))
    part = result[rows[0] : rows[-1] + 1]
    part[_hidden_from_right(part)] = np.nan
    return result


def _off_right_rim(disparity: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """The disparity without the pixels whose point the right camera sees where the skin ends in its
    row.
    """
    right = np.arange(disparity.shape[1]) - disparity
    first = np.nanmin(right, axis=1, keepdims=True, initial=np.inf)
    last = np.nanmax(right, axis=1, keepdims=True, initial=-np.inf)
    inside = np.minimum(right - first, last - right) >= RIGHT_RIM_PX
    return np.where(inside, disparity, np.nan)


def _hidden_from_right(disparity: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels whose point lies behind that of a pixel further right in the same row."""
    right = np.arange(disparity.shape[1]) - disparity
    ahead = np.minimum.accumulate(np.where(np.isfinite(right), right, np.inf)[:, ::-1], axis=1)
    nearest = np.full(right.shape, np.inf)
    nearest[:, :-1] = ahead[:, -2::-1]
    return right >= nearest
