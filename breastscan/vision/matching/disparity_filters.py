"""What a disparity map is freed of: islands, which are matches by chance, pixels that stand out,
and sub-pixel noise.

The filters work in fixed point, some hundred steps to the pixel, with `UNKNOWN` where nothing is
known: half the memory of floating point, and twice as many in a vector register.
"""

import cv2
import numpy as np
from jaxtyping import Float32, Int16, UInt16

from breastscan.geometry.compiled import kernel
from breastscan.vision.matching.lanes import (
    LANES,
    broadcast,
    count_bits,
    equal,
    less,
    load,
    minimum,
    store,
)

UNKNOWN = np.uint16(0)
ABOVE_ALL = np.uint16(65535)
LARGEST_STEPS = 256
"""Fixed-point steps a pixel at most: finer than any matcher by far."""


LIKE_PX = 1.0
"""Neighbours whose disparities differ by no more belong to one surface [px]: none that is matched
has a steeper slope."""


def filtered(
    disparity: Float32[np.ndarray, "h w"], *, speckle_px: int, median_px: int, mean_px: int
) -> Float32[np.ndarray, "h w"]:
    """The disparity [px] freed of speckles, then of outliers, then averaged over like neighbours;
    NaN where unknown.

    Args:
        disparity: Known values must not be negative [px].
        speckle_px: A connected patch of fewer pixels becomes unknown; 0 for none.
        median_px: Side of the median's window [px]; 1 for none.
        mean_px: Side of the mean's window [px]; 1 for none.
    """
    if speckle_px == 0 and median_px == mean_px == 1:
        return disparity
    largest = max(1.0, float(np.nanmax(disparity, initial=0.0)))
    steps = min(LARGEST_STEPS, int((ABOVE_ALL - 2 * LARGEST_STEPS) / largest))
    fixed = np.empty(disparity.shape, np.uint16)
    _to_fixed_point(disparity, np.float32(steps), fixed)
    if speckle_px > 0:
        remove_speckles(fixed, int(LIKE_PX * steps), speckle_px)
    if median_px > 1:
        fixed = median_of_known(fixed, median_px)
    difference_sum, count = mean_of_like(fixed, int(LIKE_PX * steps), mean_px)
    result = np.empty_like(disparity)
    _to_pixels(fixed, difference_sum, count, np.float32(1.0 / steps), result)
    return result


@kernel
def _to_fixed_point(disparity, steps, fixed):
    for y in range(disparity.shape[0]):
        for x in range(disparity.shape[1]):
            value = disparity[y, x]
            fixed[y, x] = np.uint16(value * steps + np.float32(1.5)) if value >= 0 else UNKNOWN


@kernel
def _to_pixels(fixed, difference_sum, count, size, disparity):
    for y in range(fixed.shape[0]):
        for x in range(fixed.shape[1]):
            mean = (
                np.float32(fixed[y, x])
                + np.float32(difference_sum[y, x]) / np.float32(count[y, x])
                - np.float32(1.0)
            )
            disparity[y, x] = mean * size if fixed[y, x] != UNKNOWN else np.float32(np.nan)


@kernel
def remove_speckles(fixed, step, smallest):
    """Make every connected patch of fewer than `smallest` pixels unknown; a `step` connects
    neighbours at most.

    Pixels are joined to runs along the rows, and runs that touch across rows by union-find.
    """
    height, width = fixed.shape
    runs = np.empty(
        (height * width, 3), np.int32
    )  # first pixel, length and parent of each; memory unused is not paged in
    above, here = np.full(width, -1, np.int32), np.empty(width, np.int32)
    count = 0
    for y in range(height):
        before = np.int64(UNKNOWN)
        joined = -1
        start = 0
        for x in range(width):
            value = np.int64(fixed[y, x])
            if value == UNKNOWN or before == UNKNOWN or abs(value - before) > step:
                if before != UNKNOWN:
                    runs[count - 1, 1] = x - start
                if value != UNKNOWN:
                    runs[count] = y * width + x, 0, count
                    count += 1
                joined, start = -1, x
            here[x] = count - 1 if value != UNKNOWN else -1
            upper = above[x]
            if (
                upper >= 0
                and value != UNKNOWN
                and upper != joined
                and abs(value - np.int64(fixed[y - 1, x])) <= step
            ):
                joined = upper
                _join(runs, count - 1, upper)
            before = value
        if before != UNKNOWN:
            runs[count - 1, 1] = width - start
        above, here = here, above
    _erase_small(fixed.reshape(-1), runs[:count], smallest)


@kernel
def _root(runs, run):
    while runs[run, 2] != run:
        runs[run, 2] = runs[runs[run, 2], 2]  # halves the path for the next search
        run = runs[run, 2]
    return run


@kernel
def _join(runs, a, b):
    """Under the earlier of both roots, so that a parent always comes before its children."""
    a, b = _root(runs, a), _root(runs, b)
    runs[max(a, b), 2] = min(a, b)


@kernel
def _erase_small(pixels, runs, smallest):
    sizes = np.zeros(len(runs), np.int64)
    for run in range(len(runs)):
        sizes[_root(runs, run)] += runs[run, 1]
    for run in range(len(runs)):
        if sizes[_root(runs, run)] < smallest:
            pixels[runs[run, 0] : runs[run, 0] + runs[run, 1]] = UNKNOWN


def median_of_known(fixed: UInt16[np.ndarray, "h w"], size: int) -> UInt16[np.ndarray, "h w"]:
    """Median of the known values in each pixel's window (of two middle ones the lower); unknown
    pixels stay unknown.

    The image is continued by its border pixels.
    """
    # OpenCV's filter is fast but takes unknown pixels for small ones: windows that hold one are
    # done again.
    median = cv2.medianBlur(fixed, size)
    unknown = (fixed == UNKNOWN).view(np.uint8)
    near_unknown = cv2.dilate(unknown, np.ones((size, size), np.uint8))
    _median_again(near_unknown, fixed, size // 2, median)
    return median


@kernel
def _median_again(where, fixed, half, median):
    height, width = fixed.shape
    known = np.empty(LANES, np.uint16)
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            if fixed[y, x] == UNKNOWN:
                median[y, x] = UNKNOWN
                continue
            count = 0
            for v in range(y - half, y + half + 1):
                for u in range(x - half, x + half + 1):
                    known[count] = fixed[min(max(v, 0), height - 1), min(max(u, 0), width - 1)]
                    count += 1 if known[count] != UNKNOWN else 0
            known[count:] = ABOVE_ALL
            median[y, x] = _ranked(known, count, (count - 1) // 2)


@kernel
def _ranked(values, count, rank):
    """The value that stands at `rank` once the first `count` are sorted; at most `LANES` of
    them.
    """
    lanes = load(values, 0)
    result = ABOVE_ALL
    for i in range(count):
        not_above = count_bits(equal(minimum(lanes, broadcast(values[i])), lanes))
        # no branch that could be mispredicted
        reaches = np.uint16(values[i] if not_above > rank else ABOVE_ALL)
        result = min(result, reaches)
    return result


def mean_of_like(
    fixed: UInt16[np.ndarray, "h w"], step: int, size: int
) -> tuple[Int16[np.ndarray, "h w2"], UInt16[np.ndarray, "h w2"]]:
    """Each pixel with its like neighbours: those that differ from it by `step` at most, as their
    opposite ones do.

    Lee's sigma filter [Lee 1983], but in pairs across the pixel, so that the mean of a slope is the
    slope even beside an edge.

    Returns:
        The sum of the neighbours' differences from the pixel, and how many pixels that is: the mean
        is the pixel's own value + sum / count. Rows are padded; what stands for an unknown pixel
        means nothing.
    """
    height, width = fixed.shape
    half, padded_width = size // 2, -(-width // LANES) * LANES
    bordered = np.full((height + 2 * half, padded_width + 2 * half), ABOVE_ALL)
    _copy_known(fixed, bordered[half : half + height, half : half + width])
    difference_sum, count = np.zeros((2, height * padded_width), np.uint16)
    _sum_like(
        bordered.reshape(-1), half, np.uint16(step), difference_sum, count, height, padded_width
    )
    shape = height, padded_width
    return difference_sum.view(np.int16).reshape(shape), count.reshape(shape)


@kernel
def _copy_known(fixed, bordered):
    for y in range(fixed.shape[0]):
        for x in range(fixed.shape[1]):
            bordered[y, x] = fixed[y, x] if fixed[y, x] != UNKNOWN else ABOVE_ALL


@kernel
def _sum_like(bordered, half, step, difference_sum, count, height, width):
    side = 2 * half + 1
    stride, beyond = width + 2 * half, broadcast(np.uint16(step + 1))
    for y in range(height):
        for x in range(0, width, LANES):
            centre = load(bordered, (y + half) * stride + x + half)
            total, others = broadcast(np.uint16(0)), broadcast(np.uint16(0))
            for pair in range(side * side // 2):
                place = (pair // side - half) * stride + pair % side - half
                one = load(bordered, (y + half) * stride + x + half + place)
                other = load(bordered, (y + half) * stride + x + half - place)
                alike = less(_distance(one, centre), beyond) & less(
                    _distance(other, centre), beyond
                )
                total = total + ((one + other - centre - centre) & alike)
                others = others - alike - alike  # all bits set is -1
            store(difference_sum, y * width + x, total)
            store(count, y * width + x, others + broadcast(np.uint16(1)))


@kernel
def _distance(a, b):
    """|a - b|, lane by lane."""
    smaller = minimum(a, b)
    return a - smaller + (b - smaller)
