"""Disparity of a rectified pair: census, semi-global matching, consistency, sub-pixel, median
[Zhang, Sec. II-B].
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from breastscan.errors import ConfigError, PerceptionError
from breastscan.vision.matching.census import census
from breastscan.vision.matching.disparity_filters import filtered
from breastscan.vision.matching.lanes import LANES
from breastscan.vision.matching.sgm import semi_global_disparity
from breastscan.vision.matching.sgm_kernels import LARGEST_P2, MAX_DISPARITIES, Matching

COARSE_FACTOR, COARSE_WIDTH = 4, 160
"""The coarse pass shrinks the images so many times, but no narrower than this [px]."""
COARSE_TAIL = 0.002
"""Fraction of the coarse disparities at either end that may be matches by chance."""
COARSE_MARGIN = 2
"""Coarse pixels added to the range at either end: what is too small to be seen there, and what ends
a range."""


@dataclass(frozen=True, kw_only=True)
class StereoConfig:
    """Search range and smoothness of the matcher."""

    min_disparity: int | None = None
    """Smallest disparity searched [px]; None for what a coarse pass over the pair finds."""
    num_disparities: int | None = None
    """Number of disparities searched, a multiple of 32; None for what a coarse pass over the pair
    finds."""
    paths: Literal[4, 8] = 8
    """Directions the cost is summed over [Zhang, Eq. 5]: 8, or 4 for rows and columns only."""
    P1: int = 20
    """Penalty of a disparity change by 1 px between neighbours [census bits]."""
    P2: int = 63
    """Penalty of any larger change [census bits]."""
    consistency_px: int = 1
    """Largest difference between the left and the right image's winner [px] [Zhang, Eq. 7]."""
    subpixel: Literal["equiangular", "parabola"] = "equiangular"
    """Fit of the cost about its minimum. Census costs form a V: a parabola is drawn to whole
    pixels."""
    speckle_px: int = 100
    """Connected patches of fewer pixels are matches by chance and become unknown [px]; 0 for
    none."""
    median_px: Literal[1, 3, 5] = 5
    """Side of the median filter's window [px]; 1 for none."""
    mean_px: Literal[1, 3, 5] = 5
    """Side of the window in which like disparities are averaged, to less sub-pixel noise [px]; 1
    for none."""

    def __post_init__(self) -> None:
        if self.min_disparity is not None and self.min_disparity < 0:
            raise ConfigError(
                f"perception.stereo.min_disparity must be 0 px or more, got {self.min_disparity}"
            )
        if self.num_disparities is not None and not (
            LANES <= self.num_disparities <= MAX_DISPARITIES and self.num_disparities % LANES == 0
        ):
            raise ConfigError(
                f"perception.stereo.num_disparities must be a multiple of {LANES} up to "
                f"{MAX_DISPARITIES}, got {self.num_disparities}"
            )
        if self.paths not in (4, 8):
            raise ConfigError(f"perception.stereo.paths must be 4 or 8, got {self.paths}")
        if not 0 < self.P1 <= self.P2 <= LARGEST_P2:
            raise ConfigError(f"0 < P1 <= P2 <= {LARGEST_P2} must hold, got {self.P1}, {self.P2}")
        if self.consistency_px < 0:
            raise ConfigError(
                f"perception.stereo.consistency_px must be 0 or more, got {self.consistency_px}"
            )
        if self.subpixel not in ("equiangular", "parabola"):
            raise ConfigError(
                "perception.stereo.subpixel must be 'equiangular' or 'parabola', got "
                f"{self.subpixel!r}"
            )
        if self.speckle_px < 0:
            raise ConfigError(
                f"perception.stereo.speckle_px must be 0 or more, got {self.speckle_px}"
            )
        for name in ("median_px", "mean_px"):
            if getattr(self, name) not in (1, 3, 5):
                raise ConfigError(f"{name} must be 1, 3 or 5, got {getattr(self, name)}")


def disparity_map(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h2 w2"], config: StereoConfig
) -> Float32[np.ndarray, "h w"]:
    """Disparity of every left pixel [px], NaN where unknown: the point (x, y) lies at (x -
    disparity, y) on the right.

    The same images give the same map, bit for bit, on any machine.

    Raises:
        PerceptionError: The images differ in size, or are too narrow for the search range.
    """
    if left.shape != right.shape:
        raise PerceptionError(
            f"both images of a pair must have one size, got {left.shape[1]}x{left.shape[0]} px "
            f"(left) and {right.shape[1]}x{right.shape[0]} px (right): rectify them together",
            right.shape,
        )
    if config.min_disparity is None or config.num_disparities is None:
        found = disparity_range(left, right, config)
        if found is None:
            return np.full(left.shape, np.nan, np.float32)
        config = replace(config, min_disparity=found[0], num_disparities=found[1])
    return _matched(left, right, config)


def disparity_range(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], config: StereoConfig
) -> tuple[int, int] | None:
    """Smallest disparity and number of disparities [px] around what a coarse pass matches; None if
    it matches nothing.

    What `config` gives is kept.
    """
    factor = min(max(left.shape[1] // COARSE_WIDTH, 1), COARSE_FACTOR)
    size = (left.shape[1] // factor, max(left.shape[0] // factor, 1))
    small_left, small_right = (
        cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (left, right)
    )
    # nearer surfaces fill the image and are seen by one camera only
    half_width = _whole_lanes(size[0] // 2)
    coarse = _matched(
        small_left, small_right, replace(config, min_disparity=0, num_disparities=half_width)
    )
    known = coarse[np.isfinite(coarse)]
    if known.size == 0:
        return None
    low, high = np.quantile(known, [COARSE_TAIL, 1 - COARSE_TAIL])
    smallest = config.min_disparity
    if smallest is None:
        smallest = max(0, int(factor * (low - COARSE_MARGIN)))
    count = config.num_disparities or _whole_lanes(
        int(factor * (high + COARSE_MARGIN)) + 1 - smallest
    )
    return smallest, count


def _whole_lanes(count: int) -> int:
    """The smallest multiple of `LANES` that is `count` or more, and not 0."""
    return max(-(-count // LANES), 1) * LANES


def _matched(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], config: StereoConfig
) -> Float32[np.ndarray, "h w"]:
    """The disparity within the range that `config` gives [px]."""
    assert config.min_disparity is not None
    assert config.num_disparities is not None
    height, width = left.shape
    matched = width - config.min_disparity
    if height < 1 or matched < 1:
        raise PerceptionError(
            f"an image of {width}x{height} px has no pixel that can move by min_disparity = "
            f"{config.min_disparity} px: search smaller disparities or use larger images",
            left.shape,
        )
    continued = cv2.copyMakeBorder(right, 0, 0, config.num_disparities - 1, 0, cv2.BORDER_REPLICATE)
    disparity = np.full((height, width), np.nan, np.float32)
    semi_global_disparity(
        census(left),
        census(continued),
        disparity[:, config.min_disparity :],
        disparities=config.num_disparities,
        paths=config.paths,
        matching=Matching(
            P1=np.uint8(config.P1),
            P2=np.uint8(config.P2),
            largest_disparity=config.min_disparity + config.num_disparities - 1,
            tolerance=config.consistency_px,
            equiangular=config.subpixel == "equiangular",
        ),
    )
    return filtered(
        disparity, speckle_px=config.speckle_px, median_px=config.median_px, mean_px=config.mean_px
    )
