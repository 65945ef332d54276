"""Disparity as a picture in false colours, with the scale that they stand for [Zhang, Fig. 6]."""

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

SHOWN_QUANTILES = (0.05, 0.995)
"""Where the colours end. A few per cent are chance matches, which lie far below everything else;
the nearest half per cent may be the tip of what is looked at."""
SMALLEST_RANGE_PX = 1e-6
TICKS = 5
"""Labelled places of the scale."""
FRACTIONS = (0.06, 0.02, 0.032)
"""Margin, width and height of a letter of the scale, of the picture's height."""
INK = (235, 235, 235)
FONT = cv2.FONT_HERSHEY_DUPLEX
FONT_HEIGHT_PX = 22.0
"""Of a letter of `FONT` at scale 1."""
STROKE = 0.07
"""Of a letter's height."""

Picture = UInt8[np.ndarray, "h w 3"]


def disparity_picture(disparity: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w2 3"]:
    """Disparity [px] as colours (BGR), black where unknown, and beside it the scale in px; without
    a scale where nothing is known.
    """
    known = np.isfinite(disparity)
    if not known.any():
        return np.zeros((*disparity.shape, 3), np.uint8)
    low, high = np.quantile(disparity[known], SHOWN_QUANTILES)
    high = max(high, low + SMALLEST_RANGE_PX)
    colours = _coloured((disparity - low) / (high - low))
    colours[~known] = 0
    return np.hstack([colours, _scale(len(colours), low, high)])


def _coloured(fractions: Float[np.ndarray, "h w"]) -> Picture:
    """Fractions of the range as colours; what is beyond has the colour of the end."""
    grey = np.nan_to_num(np.clip(255.0 * fractions, 0, 255)).astype(np.uint8)
    return cv2.applyColorMap(grey, cv2.COLORMAP_VIRIDIS).astype(np.uint8, copy=False)


def _scale(height: int, low: float, high: float) -> Picture:
    """A bar of the colours, the highest on top, with labels in px."""
    margin, width, letter = (max(round(fraction * height), 1) for fraction in FRACTIONS)
    size, stroke = letter / FONT_HEIGHT_PX, max(round(STROKE * letter), 1)
    labels = [f"{value:.0f} px" for value in np.linspace(high, low, TICKS)]
    text = max(cv2.getTextSize(label, FONT, size, stroke)[0][0] for label in labels)
    picture = np.zeros((height, 3 * width + text + margin, 3), np.uint8)
    bar = np.linspace(1.0, 0.0, max(height - 2 * margin, 1))
    top = (height - len(bar)) // 2
    picture[top : top + len(bar), width : 2 * width] = _coloured(bar[:, None])
    for label, row in zip(labels, np.linspace(top, top + len(bar) - 1, TICKS), strict=True):
        foot = (round(2.6 * width), round(row + 0.5 * letter))
        cv2.putText(picture, label, foot, FONT, size, INK, stroke, cv2.LINE_AA)
    return picture
