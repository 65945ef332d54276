"""A sweep of semi-global matching across the image, compiled for its settings."""

from collections.abc import Callable
from functools import cache

import numpy as np

from breastscan.vision.matching.lanes import (
    LANES,
    kernel,
    lanes_above,
    lanes_below,
    load,
    minimum,
    smallest,
    splat,
    store,
)
from breastscan.vision.matching.sgm_kernels import (
    NO_PATH,
    WORST_TOTAL,
    Front,
    advance,
    bounds,
    fill_matching_costs,
    first_index,
    ranked,
    rise_over,
    row_disparities,
    slot_start,
    total_cost,
)


@cache
def sweep_for(disparities: int, paths: int, completes: bool) -> Callable:
    """The first or the completing half of a sweep: loops of known length are a seventh faster."""

    @kernel
    def sweep(
        left,
        right,
        rises,
        costs,
        result,
        path_costs,
        floors,
        downwards,
        first_step,
        last_step,
        matching,
    ):
        """Steps `first_step` to `last_step`, in rows from where the sweep began."""
        height, width = result.shape
        first = matching.largest_disparity + 1 - disparities
        row = np.full(disparities + LANES, NO_PATH)
        totals = np.empty(width * disparities, np.uint16)
        winners = np.empty(width, np.int64)
        right_best = np.empty(width + disparities, np.uint16)
        for step_number in range(first_step, last_step):
            y = step_number if downwards else height - 1 - step_number
            row_costs, row_rises = costs[y], rises[y]
            if not completes:
                fill_matching_costs(
                    left[y].reshape(-1), right[y].reshape(-1), first, row_costs, width, disparities
                )
            old, new = (step_number + 1) % 2, step_number % 2
            behind, ahead = Front(path_costs[old], floors[old]), Front(path_costs[new], floors[new])
            right_best[:] = WORST_TOTAL
            row[:disparities] = 0
            row_floor = np.uint8(0)
            for along in range(width):
                x = along if downwards else width - 1 - along
                row_floor, winners[x] = _step(
                    x,
                    row,
                    row_floor,
                    behind,
                    ahead,
                    row_costs,
                    row_rises,
                    totals,
                    right_best,
                    matching,
                    disparities,
                    paths,
                    completes,
                )
            if completes:
                row_disparities(winners, totals, right_best, disparities, matching, result[y])

    return sweep


@kernel
def _step(
    x,
    row,
    row_floor,
    behind,
    ahead,
    costs,
    rises,
    totals,
    right_best,
    matching,
    disparities,
    paths,
    completes,
):
    """One pixel, all lines through it: gives the row's new floor and, if completing, the winner
    [Zhang, Eq. 6].
    """
    slots = ahead.floors.size // (paths // 2 - 1)
    column = x + 1
    falling, rising = column + slots, column + 2 * slots
    nothing = splat(NO_PATH)
    row_lowest = nothing
    column_lowest = nothing
    falling_lowest = nothing
    rising_lowest = nothing
    lowest = splat(WORST_TOTAL)
    row_bounds, column_bounds = bounds(row_floor, matching), bounds(behind.floors[column], matching)
    column_start = slot_start(column, disparities)
    falling_bounds = rising_bounds = column_bounds  # what four paths do not use costs nothing
    if paths == 8:
        falling_bounds = bounds(behind.floors[falling - 1], matching)
        rising_bounds = bounds(behind.floors[rising + 1], matching)
    falling_from, falling_to = (
        slot_start(falling - 1, disparities),
        slot_start(falling, disparities),
    )
    rising_from, rising_to = slot_start(rising + 1, disparities), slot_start(rising, disparities)
    before, here = nothing, load(row, 0)
    for e in range(0, disparities, LANES):
        index = x * disparities + e
        cost = load(costs, index)
        # The row's costs were stored a moment ago: unaligned loads, as `advance` makes, would wait
        # for them.
        after = load(row, e + LANES)
        rise = rise_over(
            here, minimum(lanes_below(before, here), lanes_above(here, after)), row_bounds, matching
        )
        before, here = here, after
        store(row, e, cost + rise)
        row_lowest = minimum(row_lowest, cost + rise)
        more, column_lowest = advance(
            behind.path_costs,
            column_start + e,
            column_bounds,
            ahead.path_costs,
            column_start + e,
            cost,
            column_lowest,
            matching,
        )
        rise = rise + more
        if paths == 8:
            more, falling_lowest = advance(
                behind.path_costs,
                falling_from + e,
                falling_bounds,
                ahead.path_costs,
                falling_to + e,
                cost,
                falling_lowest,
                matching,
            )
            rise = rise + more
            more, rising_lowest = advance(
                behind.path_costs,
                rising_from + e,
                rising_bounds,
                ahead.path_costs,
                rising_to + e,
                cost,
                rising_lowest,
                matching,
            )
            rise = rise + more
        if completes:
            total = total_cost(cost, rise, load(rises, index), paths)
            store(totals, index, total)
            store(right_best, x + e, minimum(load(right_best, x + e), total))
            lowest = minimum(lowest, ranked(total, e))
        else:
            store(rises, index, rise)
    ahead.floors[column] = smallest(column_lowest)
    if paths == 8:
        ahead.floors[falling] = smallest(falling_lowest)
        ahead.floors[rising] = smallest(rising_lowest)
    return smallest(row_lowest), first_index(lowest) if completes else 0
