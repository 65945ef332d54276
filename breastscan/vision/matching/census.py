"""Census transform [Zhang, Eq. 2] and the Hamming distance of two census strings [Zhang, Eq. 3], 32
at a time.

The 62 comparisons of a 9 x 7 window fill eight byte planes: plane k holds bits 8k to 8k+7 of every
pixel's string, so that one vector load fetches the same bits of 32 neighbouring pixels.
"""

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan.geometry.compiled import kernel
from breastscan.vision.matching.lanes import (
    LANES,
    broadcast,
    chosen,
    count_ones,
    less,
    load,
    store,
)

HALF_WIDTH, HALF_HEIGHT = 4, 3
"""Half of the window [px]: 9 x 7 is the largest window whose string fits eight bytes."""
PLANES = 8
LARGEST_COST = (2 * HALF_WIDTH + 1) * (2 * HALF_HEIGHT + 1) - 1
"""Hamming distance of two strings that differ in every bit."""


def census(image: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h 8 w_padded"]:
    """Census string of every pixel: a bit is 0 where the neighbour is brighter than the centre,
    else 1 [Zhang, Eq. 2].

    The image is continued by its border pixels. Rows are padded to a multiple of `LANES`; the
    padding means nothing.
    """
    height, width = image.shape
    padded_width = -(-width // LANES) * LANES
    bordered = cv2.copyMakeBorder(
        image,
        HALF_HEIGHT,
        HALF_HEIGHT,
        HALF_WIDTH,
        HALF_WIDTH + padded_width - width,
        cv2.BORDER_REPLICATE,
    )
    dy, dx = np.mgrid[-HALF_HEIGHT : HALF_HEIGHT + 1, -HALF_WIDTH : HALF_WIDTH + 1].reshape(2, -1)
    is_neighbour = (dy != 0) | (dx != 0)
    # the two bits left over compare the centre with itself: 1 in any image
    offsets = np.zeros(8 * PLANES, np.int64)
    offsets[:LARGEST_COST] = (dy * bordered.shape[1] + dx)[is_neighbour]
    planes = np.empty((height, PLANES, padded_width), np.uint8)
    _fill_planes(bordered.ravel(), bordered.shape[1], offsets, planes.ravel(), height, padded_width)
    return planes


@kernel
def _fill_planes(image, stride, offsets, planes, height, width):
    nothing = broadcast(np.uint8(0))
    for y in range(height):
        for x in range(0, width, LANES):
            pixel = (y + HALF_HEIGHT) * stride + x + HALF_WIDTH
            centre = load(image, pixel)
            for plane in range(PLANES):
                bits = nothing
                for bit in range(8):
                    neighbour = load(image, pixel + offsets[8 * plane + bit])
                    bits = bits | chosen(
                        less(centre, neighbour), nothing, broadcast(np.uint8(1 << bit))
                    )
                store(planes, (y * PLANES + plane) * width + x, bits)


@kernel
def full_adder(a, b, c):
    """Sum and carry bits of three one-bit numbers, in every bit of every lane."""
    either = a ^ b
    return either ^ c, (a & b) | (either & c)


@kernel
def hamming(d0, d1, d2, d3, d4, d5, d6, d7):
    """Number of bits set in eight bytes [Zhang, Eq. 3]; adding bits before counting them halves
    the work.
    """
    sum_a, carry_a = full_adder(d0, d1, d2)
    sum_b, carry_b = full_adder(d3, d4, d5)
    ones, carry_c = full_adder(sum_a, sum_b, d6)
    twos, fours = full_adder(carry_a, carry_b, carry_c)
    pairs = count_ones(fours) + count_ones(fours) + count_ones(twos)
    return count_ones(ones) + count_ones(d7) + pairs + pairs
