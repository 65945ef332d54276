"""Pairs that cannot be measured: lens caps, glare, bare walls, exchanged cables. Each is said
with its cure.
"""

import numpy as np
from jaxtyping import Float32, UInt8

from breastscan.errors import PerceptionError

DARKEST_SHADE = 12
"""An image with hardly a pixel brighter than this is black [grey levels]: a tenth of a usual
exposure."""
BRIGHTEST_SHADE = 254
"""From here on a pixel is saturated [grey levels]."""
MAX_SATURATED_FRACTION = 0.5
SMALLEST_CONTRAST = 6.0
"""An image whose grey levels span less has no texture to match [grey levels]; its noise alone spans
this much."""
TAIL = 0.02
"""Fraction of the pixels at either end that may be anything: dust, hot pixels, reflections."""
EXCHANGED_GAIN = 1.25
"""The images are exchanged if, swapped, this many times as many pixels match: of two
unrelated images, too, a third may."""
MIN_FRACTION = 0.05
"""Fewer matches say nothing about the order: the two images do not belong together."""
LEAST_MATCHED = 0.1
"""Of the pixels of a view, that have to match for its depth to be trusted [-]."""
FARTHEST = 100.0
"""Median depth of a view that is trusted, in baselines: a disparity of 10 px or so in pictures of
1000 px."""


def check_exposure(image: UInt8[np.ndarray, "h w"], name: str) -> None:
    """Refuse an image in which nothing can be matched.

    Raises:
        PerceptionError: `name` is black, saturated or without texture.
    """
    darkest, brightest = np.quantile(image, [TAIL, 1 - TAIL])
    saturated = float(np.mean(image >= BRIGHTEST_SHADE))
    if brightest < DARKEST_SHADE:
        raise PerceptionError(
            f"{name} is black: expected grey levels up to 100 or more, found {brightest:.0f} of "
            "255: take off the lens cap, add light or expose longer",
            float(brightest),
        )
    if saturated > MAX_SATURATED_FRACTION:
        raise PerceptionError(
            f"{name} is saturated: {100 * saturated:.0f} % of its pixels are white, expected less "
            f"than {100 * MAX_SATURATED_FRACTION:.0f} %: expose shorter or dim the lamp",
            saturated,
        )
    if brightest - darkest < SMALLEST_CONTRAST:
        raise PerceptionError(
            f"{name} has no texture: its grey levels span {brightest - darkest:.0f} of 255, "
            f"expected {SMALLEST_CONTRAST:.0f} or more: point the camera at the scene, focus it, "
            "or project a pattern",
            float(brightest - darkest),
        )


def check_exchanged(
    matched: Float32[np.ndarray, "h w"], exchanged: Float32[np.ndarray, "h w"]
) -> None:
    """Refuse a pair whose disparity is known at more pixels with left and right exchanged.

    Args:
        matched: Disparity of the pair as given [px], NaN where unknown.
        exchanged: Disparity of the pair with left and right exchanged [px].

    Raises:
        PerceptionError: Left and right are exchanged.
    """
    fraction, exchanged_fraction = _known_fraction(matched), _known_fraction(exchanged)
    if exchanged_fraction > max(EXCHANGED_GAIN * fraction, MIN_FRACTION):
        raise PerceptionError(
            f"the left and the right image are exchanged: {100 * fraction:.0f} % of the pixels "
            f"match as given, {100 * exchanged_fraction:.0f} % the other way round: exchange the "
            "two files, or the cameras' cables",
            fraction,
        )


def check_depth(depth: Float32[np.ndarray, "h w"], baseline: float) -> None:
    """Refuse a view of which hardly anything matches, or that is too far away for its cameras.

    Args:
        depth: Of every pixel [m], NaN where unknown.
        baseline: Distance of the cameras [m].

    Raises:
        PerceptionError: Then what matches may be chance.
    """
    matched, median = _known_fraction(depth), float(np.nanmedian(depth))
    if matched < LEAST_MATCHED:
        raise PerceptionError(
            f"{100 * matched:.1f} % of the view matches, at least {100 * LEAST_MATCHED:.0f} % are "
            "expected: are the pictures of one scene and one instant, is the rig file theirs, is "
            "there texture and light? `--accept` writes what there is",
            matched,
        )
    if median > FARTHEST * baseline:
        raise PerceptionError(
            f"half of what matches is more than {median:.3g} m away, {median / baseline:.0f} times "
            f"the cameras' {baseline * 1e3:.0f} mm, at most {FARTHEST:g} times are expected: is "
            "the rig file theirs, are the pictures not cropped? `--accept` writes what there is",
            median,
        )


def _known_fraction(disparity: Float32[np.ndarray, "h w"]) -> float:
    return float(np.mean(np.isfinite(disparity)))
