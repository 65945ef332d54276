"""Whether a rectified pair fits its rig: corresponding points lie on the same row, and none beyond
infinity. Features are matched wherever they are, so that a pair of another rig is found out, which
a matcher along rows fills with chance.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.errors import PerceptionError

WIDEST = 1200
"""Wider pictures are shrunk to this before features are sought [px]."""
RATIO = 0.75
"""Of the distances to the nearest and to the second nearest feature, below which the nearest one is
a match [-] [Lowe, IJCV 2004]."""
FEWEST = 20
"""Matches below which nothing is said."""
EPIPOLAR_PX = 1.5
"""How far a match may lie from its line in whatever geometry fits most of them [px]."""
SHARE = 0.4
"""Of the matches, that some geometry must fit [-]: of a pair of one scene most do."""
LARGEST_ROW_ERROR_PX = 3.0
"""Between the rows of corresponding points, as a median [px]: the refinement mends what is less."""
BEYOND_PX, LARGEST_BEYOND = 1.5, 0.35
"""How far on the wrong side a point is beyond infinity [px], and the share of such [-]."""


@dataclass(frozen=True)
class Rows:
    """What matched features say of a rectified pair."""

    error_px: float
    """Between the rows of corresponding points, median [px]."""
    beyond: float
    """Share of the points that lie beyond infinity [-]."""


def check_rows(left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"]) -> None:
    """Refuse a rectified pair that does not fit its rig.

    Raises:
        PerceptionError: Corresponding points lie on other rows, or beyond infinity.
    """
    rows = measured(left, right)
    if rows is None:
        return
    if rows.error_px > LARGEST_ROW_ERROR_PX:
        raise PerceptionError(
            f"the pair does not fit its rig: once rectified, what belongs together lies "
            f"{rows.error_px:.1f} px apart in height, at most {LARGEST_ROW_ERROR_PX:g} px are "
            "expected: is this the rig file of these two cameras at this setting, are both "
            "pictures of one instant, the right way up and not cropped?",
            rows,
        )
    if rows.beyond > LARGEST_BEYOND:
        raise PerceptionError(
            f"the pair does not fit its rig: {rows.beyond:.0%} of what is seen in both pictures "
            f"would lie beyond infinity, at most {LARGEST_BEYOND:.0%} are expected: are left and "
            "right exchanged, or the pictures cropped or upside down? Otherwise calibrate anew",
            rows,
        )


def measured(left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"]) -> Rows | None:
    """How a rectified pair's features lie; None where too few are seen in both."""
    scale = min(1.0, WIDEST / left.shape[1])
    matched = _matched(*(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
                         for image in (left, right)))  # fmt: skip
    if len(matched) < FEWEST:
        return None
    _, fits = cv2.findFundamentalMat(
        matched[:, 0], matched[:, 1], cv2.USAC_MAGSAC, EPIPOLAR_PX, 0.999, 10_000
    )
    if fits is None or fits.sum() < max(FEWEST, SHARE * len(matched)):
        return None
    apart = (matched[:, 0] - matched[:, 1])[fits.ravel() > 0] / scale
    return Rows(
        error_px=float(np.median(np.abs(apart[:, 1]))),
        beyond=float(np.mean(apart[:, 0] < -BEYOND_PX)),
    )


def _matched(
    left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"]
) -> Float[np.ndarray, "n 2 2"]:
    """Places of features that are each other's nearest, left and right [px]."""
    finder = cv2.SIFT_create(nfeatures=4000)  # pyright: ignore[reportAttributeAccessIssue]
    (on_left, of_left), (on_right, of_right) = (
        finder.detectAndCompute(image, None) for image in (left, right)
    )
    if of_left is None or of_right is None or min(len(of_left), len(of_right)) < 2:
        return np.empty((0, 2, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    there = {
        best.queryIdx: best.trainIdx
        for best, second in matcher.knnMatch(of_left, of_right, k=2)
        if best.distance < RATIO * second.distance
    }
    back = {best.queryIdx: best.trainIdx for best in matcher.match(of_right, of_left)}
    return np.array(
        [(on_left[i].pt, on_right[j].pt) for i, j in there.items() if back[j] == i]
    ).reshape(-1, 2, 2)
