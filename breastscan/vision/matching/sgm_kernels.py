"""The steps of semi-global matching at one pixel, for all its disparities [Zhang, Eqs. 3-7].

Index e of a cost row stands for disparity `largest_disparity - e`: so the right image is read from
left to right.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from breastscan.geometry.compiled import kernel
from breastscan.vision.matching.census import PLANES, hamming
from breastscan.vision.matching.lanes import (
    LANES,
    add_saturated,
    broadcast,
    equal,
    first_bit,
    load,
    minimum,
    smallest,
    store,
    widened,
)

NO_PATH = np.uint8(255)
"""Cost of a disparity outside the range: no path comes from there."""
LARGEST_P2 = 63
"""What the paths of one sweep add to the matching cost, four times P2 at most, is kept in 8
bits."""
WORST_TOTAL = np.uint16(65535)
BLOCK_BITS = np.uint16(6)
"""Bits of a block's number below a total: 8 paths of at most 62 + 63 each leave them free."""
MAX_DISPARITIES = LANES << int(BLOCK_BITS)


class Matching(NamedTuple):
    """Settings of the matcher, as numba takes them."""

    P1: np.uint8
    """Penalty of a disparity change by one [bits]."""
    P2: np.uint8
    """Penalty of any larger change [bits]."""
    largest_disparity: int
    """Disparity of index 0 [px]."""
    tolerance: int
    """Largest difference between the left and the right winner [px]."""
    equiangular: bool
    """Sub-pixel fit by two lines of opposite slope, else by a parabola."""


class Front(NamedTuple):
    """Where a sweep stands: the path costs of one image row, for each of the directions that come
    from the row behind.

    A line's path costs fill a slot of their own, with `NO_PATH` before and after them, so that d -
    1 and d + 1 can be loaded like d. Every direction has a slot for each pixel and one off either
    end of the row, whose costs stay 0: a line that enters the image has no predecessor, and its
    first path cost is the matching cost.
    """

    path_costs: UInt8[np.ndarray, "n"]
    minima: UInt8[np.ndarray, "slots"]
    """The minimum path cost in each slot."""


@kernel
def slot_start(slot, disparities):
    """Where the path costs of a slot begin in a `Front`."""
    return LANES + slot * (disparities + LANES)


@kernel
def census_string(planes, x):
    """The eight bytes of the string at x, each in all lanes."""
    n = planes.size // PLANES
    return (
        broadcast(planes[x]),
        broadcast(planes[x + n]),
        broadcast(planes[x + 2 * n]),
        broadcast(planes[x + 3 * n]),
        broadcast(planes[x + 4 * n]),
        broadcast(planes[x + 5 * n]),
        broadcast(planes[x + 6 * n]),
        broadcast(planes[x + 7 * n]),
    )


@kernel
def matching_cost(string, planes, x):
    """C(p, d): the Hamming distances [Zhang, Eq. 3] of `string` and those at x and the 31 pixels
    after it.
    """
    n = planes.size // PLANES
    b0, b1, b2, b3, b4, b5, b6, b7 = string
    return hamming(
        b0 ^ load(planes, x),
        b1 ^ load(planes, x + n),
        b2 ^ load(planes, x + 2 * n),
        b3 ^ load(planes, x + 3 * n),
        b4 ^ load(planes, x + 4 * n),
        b5 ^ load(planes, x + 5 * n),
        b6 ^ load(planes, x + 6 * n),
        b7 ^ load(planes, x + 7 * n),
    )


@kernel
def fill_matching_costs(left_row, right_row, first, costs, width, disparities):
    """C(p, d) for the left columns from `first` on, all disparities of one before those of the
    next.
    """
    for x in range(width):
        string = census_string(left_row, first + x)
        for e in range(0, disparities, LANES):
            store(costs, x * disparities + e, matching_cost(string, right_row, x + e))


@kernel
def bounds(minimum_cost, matching):
    """The minimum path cost behind, and what a jump from there costs: in every lane, once for all
    disparities.
    """
    return broadcast(minimum_cost), broadcast(np.uint8(minimum_cost + matching.P2))


@kernel
def path_cost_increment(here, beside, behind, matching):
    """The path-cost increment L_r(p, d) - C(p, d) [Zhang, Eq. 4] from the pixel behind p on the
    line.

    Args:
        here: Its path costs at d.
        beside: The smaller ones of those at d - 1 and d + 1.
        behind: Its `bounds`.
        matching: The penalties.
    """
    minimum_cost, jump = behind
    return (
        minimum(minimum(here, add_saturated(beside, broadcast(matching.P1))), jump) - minimum_cost
    )


@kernel
def advance(path_costs, start, behind, ahead_costs, ahead_start, cost, lowest, matching):
    """One line, one pixel onwards: stores L_r(p, d) at `ahead_start`, gives L_r - C and the
    minimum L_r so far.
    """
    beside = minimum(load(path_costs, start - 1), load(path_costs, start + 1))
    increment = path_cost_increment(load(path_costs, start), beside, behind, matching)
    store(ahead_costs, ahead_start, cost + increment)
    return increment, minimum(lowest, cost + increment)


@kernel
def total_cost(cost, increments, stored_increments, paths):
    """S(p, d), the sum of all paths [Zhang, Eq. 5]: `paths` times C, and what either sweep's
    paths add to it.
    """
    twice = cost + cost
    if paths == 4:  # all increments together still fit 8 bits, and so does 4 C
        return widened(twice + twice) + widened(increments + stored_increments)
    quadruple = widened(twice + twice)
    return quadruple + quadruple + widened(increments) + widened(stored_increments)


@kernel
def ranked(total, e):
    """Totals at e and after, each with the number of its `LANES` disparities below it: one
    minimum compares both.
    """
    return (total << broadcast(BLOCK_BITS)) + broadcast(np.uint16(e // LANES))


@kernel
def first_index(ranks):
    """Index of the minimum total [Zhang, Eq. 6]: of equal ones the nearest surface."""
    lowest = smallest(ranks)
    block = lowest & ((1 << BLOCK_BITS) - 1)
    return np.int64(block) * LANES + first_bit(equal(ranks, broadcast(lowest)))


@kernel
def row_disparities(winners, totals, right_best, disparities, matching, result):
    """One row's disparities [px], NaN where left and right disagree [Zhang, Eq. 7] or the winner
    ends the range.
    """
    for x in range(result.size):
        winner = winners[x]
        in_range = 0 < winner < disparities - 1 and x + winner >= disparities - 1
        if in_range and _agrees(
            totals, right_best, x, winner, matching.tolerance, disparities, result.size
        ):
            offset = _sub_pixel(totals, x * disparities + winner, matching.equiangular)
            result[x] = matching.largest_disparity - (winner + offset)
        else:
            result[x] = np.nan


@kernel
def _agrees(totals, right_best, x, winner, tolerance, disparities, width):
    """Whether a best disparity of the right pixel lies within `tolerance` of the left winner."""
    best = right_best[x + winner]
    # so nearly everywhere: the processor guesses it right
    if totals[x * disparities + winner] == best:
        return True
    for shift in range(-tolerance, tolerance + 1):
        left_x, e = x + shift, winner - shift
        if (
            0 <= left_x < width
            and 0 <= e < disparities
            and totals[left_x * disparities + e] == best
        ):
            return True
    return False


@kernel
def _sub_pixel(totals, index, equiangular):
    """Where between its neighbours the minimum lies, in -.5 to .5 of an index."""
    before = np.int64(totals[index - 1])
    lowest = np.int64(totals[index])
    after = np.int64(totals[index + 1])
    span = 2 * (max(before, after) - lowest) if equiangular else 2 * (before + after - 2 * lowest)
    return (before - after) / span if span > 0 else 0.0
