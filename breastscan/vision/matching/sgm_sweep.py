"""A sweep of semi-global matching across the image, compiled for its settings."""

from collections.abc import Callable
from functools import cache

import numpy as np

from breastscan.geometry.compiled import kernel
from breastscan.vision.matching.lanes import (
    LANES,
    broadcast,
    lanes_above,
    lanes_below,
    load,
    minimum,
    smallest,
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
    path_cost_increment,
    ranked,
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
        increments,
        costs,
        result,
        path_costs,
        minima,
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
            row_costs, row_increments = costs[y], increments[y]
            if not completes:
                fill_matching_costs(
                    left[y].reshape(-1), right[y].reshape(-1), first, row_costs, width, disparities
                )
            old, new = (step_number + 1) % 2, step_number % 2
            behind, ahead = Front(path_costs[old], minima[old]), Front(path_costs[new], minima[new])
            right_best[:] = WORST_TOTAL
            row[:disparities] = 0
            row_minimum = np.uint8(0)
            for along in range(width):
                x = along if downwards else width - 1 - along
                row_minimum, winners[x] = _step(
                    x,
                    row,
                    row_minimum,
                    behind,
                    ahead,
                    row_costs,
                    row_increments,
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
    row_minimum,
    behind,
    ahead,
    costs,
    increments,
    totals,
    right_best,
    matching,
    disparities,
    paths,
    completes,
):
    """One pixel, all paths through it: gives the row's new minimum path cost and, if completing,
    the winner [Zhang, Eq. 6].
    """
    slots = ahead.minima.size // (paths // 2 - 1)
    column = x + 1
    diagonal, antidiagonal = column + slots, column + 2 * slots
    nothing = broadcast(NO_PATH)
    row_lowest = nothing
    column_lowest = nothing
    diagonal_lowest = nothing
    antidiagonal_lowest = nothing
    lowest = broadcast(WORST_TOTAL)
    row_bounds = bounds(row_minimum, matching)
    column_bounds = bounds(behind.minima[column], matching)
    column_start = slot_start(column, disparities)
    diagonal_bounds = column_bounds  # what four paths do not use costs nothing
    antidiagonal_bounds = column_bounds
    if paths == 8:
        diagonal_bounds = bounds(behind.minima[diagonal - 1], matching)
        antidiagonal_bounds = bounds(behind.minima[antidiagonal + 1], matching)
    diagonal_from = slot_start(diagonal - 1, disparities)
    diagonal_to = slot_start(diagonal, disparities)
    antidiagonal_from = slot_start(antidiagonal + 1, disparities)
    antidiagonal_to = slot_start(antidiagonal, disparities)
    before, here = nothing, load(row, 0)
    for e in range(0, disparities, LANES):
        index = x * disparities + e
        cost = load(costs, index)
        # The row's costs were stored a moment ago: unaligned loads, as `advance` makes, would wait
        # for them.
        after = load(row, e + LANES)
        increment = path_cost_increment(
            here, minimum(lanes_below(before, here), lanes_above(here, after)), row_bounds, matching
        )
        before, here = here, after
        store(row, e, cost + increment)
        row_lowest = minimum(row_lowest, cost + increment)
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
        increment = increment + more
        if paths == 8:
            more, diagonal_lowest = advance(
                behind.path_costs,
                diagonal_from + e,
                diagonal_bounds,
                ahead.path_costs,
                diagonal_to + e,
                cost,
                diagonal_lowest,
                matching,
            )
            increment = increment + more
            more, antidiagonal_lowest = advance(
                behind.path_costs,
                antidiagonal_from + e,
                antidiagonal_bounds,
                ahead.path_costs,
                antidiagonal_to + e,
                cost,
                antidiagonal_lowest,
                matching,
            )
            increment = increment + more
        if completes:
            total = total_cost(cost, increment, load(increments, index), paths)
            store(totals, index, total)
            store(right_best, x + e, minimum(load(right_best, x + e), total))
            lowest = minimum(lowest, ranked(total, e))
        else:
            store(increments, index, increment)
    ahead.minima[column] = smallest(column_lowest)
    if paths == 8:
        ahead.minima[diagonal] = smallest(diagonal_lowest)
        ahead.minima[antidiagonal] = smallest(antidiagonal_lowest)
    return smallest(row_lowest), first_index(lowest) if completes else 0
