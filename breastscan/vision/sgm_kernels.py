"""The steps of semi-global matching at one pixel, for all its disparities [Zhang, Eqs. 3-7].

Index e of a cost row stands for disparity `largest_disparity - e`: so the right image is read from left to right.
"""

from typing import NamedTuple

import numpy as np

from breastscan.vision.census import PLANES, hamming
from breastscan.vision.lanes import (
    LANES,
    add_saturated,
    first_equal,
    kernel,
    lanes_above,
    lanes_below,
    load,
    minimum,
    smallest,
    splat,
    store,
    widened,
)

NO_PATH = np.uint8(255)
"""Cost of a disparity outside the range: no path comes from there."""
WORST_TOTAL = np.uint16(65535)


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


@kernel
def begin_line(path_costs, floors, line, disparities):
    """A line's first pixel has no predecessor: its path cost will be the matching cost."""
    floors[line] = 0
    for e in range(0, disparities, LANES):
        store(path_costs, line * disparities + e, splat(np.uint8(0)))


@kernel
def matching_cost(left, right, x, cost, disparities):
    """C(p, d): the Hamming distances of the census strings [Zhang, Eq. 3], into `cost`."""
    n, m = left.size // PLANES, right.size // PLANES
    l0, l1, l2, l3 = splat(left[x]), splat(left[x + n]), splat(left[x + 2 * n]), splat(left[x + 3 * n])
    l4, l5, l6, l7 = splat(left[x + 4 * n]), splat(left[x + 5 * n]), splat(left[x + 6 * n]), splat(left[x + 7 * n])
    for e in range(0, disparities, LANES):
        r = x + e
        distance = hamming(
            l0 ^ load(right, r),
            l1 ^ load(right, r + m),
            l2 ^ load(right, r + 2 * m),
            l3 ^ load(right, r + 3 * m),
            l4 ^ load(right, r + 4 * m),
            l5 ^ load(right, r + 5 * m),
            l6 ^ load(right, r + 6 * m),
            l7 ^ load(right, r + 7 * m),
        )
        store(cost, e, distance)


@kernel
def advance(path_costs, floors, line, cost, sums, sums_start, disparities, matching):
    """One line, one pixel onwards: its path costs become L_r(p, d) [Zhang, Eq. 4], and `sums` gain L_r - C."""
    start = line * disparities
    floor, jump = splat(floors[line]), splat(np.uint8(floors[line] + matching.P2))
    before, here, lowest = splat(NO_PATH), load(path_costs, start), splat(NO_PATH)
    for e in range(0, disparities, LANES):
        after = load(path_costs, start + e + LANES) if e + LANES < disparities else splat(NO_PATH)
        beside = minimum(lanes_below(before, here), lanes_above(here, after))
        rise = minimum(minimum(here, add_saturated(beside, splat(matching.P1))), jump) - floor
        path_cost = load(cost, e) + rise
        store(path_costs, start + e, path_cost)
        store(sums, sums_start + e, load(sums, sums_start + e) + rise)
        lowest = minimum(lowest, path_cost)
        before, here = here, after
    floors[line] = smallest(lowest)


@kernel
def complete(cost, stored, start, sums, totals, right_best, x, disparities, paths):
    """S(p, d), the sum of all paths [Zhang, Eq. 5], from the sums of both sweeps; gives the winner [Zhang, Eq. 6].

    Clears `sums` for the next pixel, and lowers the best totals of the right pixels that this one was compared with.
    """
    lowest = splat(WORST_TOTAL)
    for e in range(0, disparities, LANES):
        twice = widened(load(cost, e)) + widened(load(cost, e))
        quadruple = twice + twice
        matching_costs = quadruple + quadruple if paths == 8 else quadruple
        total = widened(load(stored, start + e)) + widened(load(sums, e)) + matching_costs
        store(totals, start + e, total)
        store(sums, e, splat(np.uint8(0)))
        store(right_best, x + e, minimum(load(right_best, x + e), total))
        lowest = minimum(lowest, total)
    least = splat(smallest(lowest))
    winner = 0
    for e in range(disparities - LANES, -1, -LANES):  # backwards, so that the first of equals, the nearest, stays
        lane = first_equal(load(totals, start + e), least)
        winner = e + lane if lane < LANES else winner
    return winner


@kernel
def row_disparities(winners, totals, right_best, disparities, matching, result):
    """One row's disparities [px], NaN where left and right disagree [Zhang, Eq. 7] or the winner ends the range."""
    for x in range(result.size):
        winner = winners[x]
        in_range = 0 < winner < disparities - 1 and x + winner >= disparities - 1
        if in_range and _agrees(totals, right_best, x, winner, matching.tolerance, disparities, result.size):
            offset = _sub_pixel(totals, x * disparities + winner, matching.equiangular)
            result[x] = matching.largest_disparity - (winner + offset)
        else:
            result[x] = np.nan


@kernel
def _agrees(totals, right_best, x, winner, tolerance, disparities, width):
    """Whether a best disparity of the right pixel lies within `tolerance` of the left winner."""
    best = right_best[x + winner]
    for shift in range(-tolerance, tolerance + 1):
        left_x, e = x + shift, winner - shift
        if 0 <= left_x < width and 0 <= e < disparities and totals[left_x * disparities + e] == best:
            return True
    return False


@kernel
def _sub_pixel(totals, index, equiangular):
    """Where between its neighbours the minimum lies, in -.5 to .5 of an index."""
    before, least, after = np.int64(totals[index - 1]), np.int64(totals[index]), np.int64(totals[index + 1])
    span = 2 * (max(before, after) - least) if equiangular else 2 * (before + after - 2 * least)
    return (before - after) / span if span > 0 else 0.0
