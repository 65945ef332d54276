"""An indoor-like stereo pair of known disparity with sharp depth edges, which a breast never shows.

A textured wall, weakly textured boards before it and a slanted floor. Each image is painted from
the surface nearest to its own camera at each pixel, so that what only one camera sees is occluded
as in a room.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import gaussian_filter, map_coordinates

WALL_PX = 72.0
"""Disparity of the wall [px]."""
FLOOR_SLOPE = 0.12
"""Increase of the floor's disparity from row to row [px]."""
BOARDS = (
    (0.08, 0.30, 0.08, 0.55, 96.0, 1.0),
    (0.35, 0.48, 0.15, 0.85, 118.0, 0.25),
    (0.55, 0.90, 0.10, 0.40, 88.0, 0.15),
    (0.60, 0.66, 0.35, 0.95, 140.0, 1.0),
    (0.75, 0.96, 0.55, 0.80, 105.3, 0.5),
)
"""Left, right, top and bottom as fractions of the left image, disparity [px], and contrast over
that of the wall."""
CONTRAST = 22.0
"""Standard deviation of the wall's texture [grey levels]."""


@dataclass(frozen=True, kw_only=True)
class EdgePair:
    """A rectified pair and its truth."""

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]
    disparity: Float[np.ndarray, "h w"]
    """Of every left pixel [px], NaN where it is not known."""
    seen_twice: Bool[np.ndarray, "h w"]
    """Left pixels whose surface the right camera sees too."""


def edge_pair(
    *, width: int = 960, height: int = 640, noise: float = 1.0, seed: int = 0
) -> EdgePair:
    """Render the room, with normal noise of standard deviation `noise` [grey levels]."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width].astype(float)
    left_disparity, left, right_disparity, right = (np.zeros((height, width)) for _ in range(4))
    for inside, disparity, contrast in _surfaces(width, height):
        texture = _texture(rng, height, width, contrast)
        d = disparity(rows)
        _paint(left_disparity, left, d, inside(rows, columns), texture, rows, columns)
        _paint(right_disparity, right, d, inside(rows, columns + d), texture, rows, columns + d)
    at = np.rint(columns - left_disparity).astype(int)
    there = np.take_along_axis(right_disparity, np.clip(at, 0, width - 1), axis=1)
    noisy = [np.rint(image + noise * rng.standard_normal(image.shape)) for image in (left, right)]
    return EdgePair(
        left=np.clip(noisy[0], 0, 255).astype(np.uint8),
        right=np.clip(noisy[1], 0, 255).astype(np.uint8),
        disparity=left_disparity,
        seen_twice=(at >= 0) & (np.abs(there - left_disparity) < 0.5),
    )


def _surfaces(width: int, height: int) -> Iterator[tuple[Callable, Callable, float]]:
    """Each surface: whether it covers a left pixel, its disparity by row, and its contrast; the
    farthest first.
    """
    yield (lambda y, x: np.ones_like(x, bool)), (lambda y: np.full_like(y, WALL_PX)), 1.0
    horizon = 0.7 * height
    yield (
        (lambda y, x: y > horizon),
        (lambda y: WALL_PX + FLOOR_SLOPE * np.maximum(y - horizon, 0)),
        0.6,
    )
    for left, right, top, bottom, disparity, contrast in sorted(BOARDS, key=lambda board: board[4]):
        box = (left * width, right * width, top * height, bottom * height)
        yield (
            (lambda y, x, box=box: (x >= box[0]) & (x < box[1]) & (y >= box[2]) & (y < box[3])),
            (lambda y, disparity=disparity: np.full_like(y, disparity)),
            contrast,
        )


def _texture(
    rng: np.random.Generator, height: int, width: int, contrast: float
) -> Float[np.ndarray, "h w2"]:
    """Fine and coarse blotches about a shade of the surface's own, wide enough for both views."""
    fine, coarse = (
        size * gaussian_filter(rng.standard_normal((height, 2 * width)), size)
        for size in (1.0, 3.0)
    )
    blotches = fine + coarse
    return rng.uniform(90, 160) + contrast * CONTRAST * blotches / blotches.std()


def _paint(
    front: Float[np.ndarray, "h w"],
    image: Float[np.ndarray, "h w"],
    disparity: Float[np.ndarray, "h w"],
    inside: Bool[np.ndarray, "h w"],
    texture: Float[np.ndarray, "h w2"],
    rows: Float[np.ndarray, "h w"],
    left_columns: Float[np.ndarray, "h w"],
) -> None:
    """Where the surface is inside and nearer than what is painted, its grey levels; it is seen
    at `left_columns`.
    """
    nearest = inside & (disparity > front)
    front[nearest] = disparity[nearest]
    image[nearest] = map_coordinates(
        texture, [rows[nearest], left_columns[nearest]], order=3, mode="nearest"
    )
