"""Semi-global matching [Zhang, Eqs. 4-7]: exact path costs over the whole image, 32 disparities at a time.

Two sweeps cross the image, one downwards and one upwards, each with the paths that come from behind it: along its row,
straight, and along both diagonals. Each keeps the running cost of every line of pixels in a slot of its own, and
replaces it where it stands. The sweeps start together, store the sums of their first half (8 bit: one path adds P2 at
most to the matching cost), meet in the middle, and each completes the half that the other has stored.
"""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from jaxtyping import Float32, UInt8

from breastscan.vision.lanes import kernel
from breastscan.vision.sgm_kernels import (
    WORST_TOTAL,
    Matching,
    advance,
    begin_line,
    complete,
    matching_cost,
    row_disparities,
)


def semi_global_disparity(
    left: UInt8[np.ndarray, "h 8 w_left"],
    right: UInt8[np.ndarray, "h 8 w_right"],
    *,
    width: int,
    disparities: int,
    paths: int,
    matching: Matching,
) -> Float32[np.ndarray, "h width"]:
    """Disparity of each left pixel [px], NaN where the right image disagrees or the winner ends the range.

    Args:
        left: Census planes of the left pixels.
        right: Census planes of the right pixels; column x + e is compared with left column x at index e.
        width: Number of left columns to match.
        disparities: Number of disparities, a multiple of `LANES`.
        paths: 8, or 4 for rows and columns only.
        matching: Penalties, consistency and sub-pixel fit.
    """
    height = left.shape[0]
    middle = height // 2
    volume = _zeroed_volume(height, width, disparities)
    result = np.empty((height, width), np.float32)
    lines = 1 + (paths // 2 - 1) * width
    path_costs = np.zeros((2, lines * disparities), np.uint8)
    floors = np.zeros((2, lines), np.uint8)
    sweep = _sweep_for(disparities, paths)

    def run(downwards: bool, first_step: int, last_step: int, completes: bool) -> None:
        side = int(downwards)
        sweep(
            left, right, volume, result, path_costs[side], floors[side], downwards, first_step, last_step, completes,
            matching,
        )  # fmt: skip

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(run, (True, False), (0, 0), (middle, height - middle), (False, False)))
        list(pool.map(run, (True, False), (middle, height - middle), (height, height), (True, True)))
    return result


class _Memory(threading.local):
    volume = np.empty(0, np.uint8)


_memory = _Memory()


def _zeroed_volume(height: int, width: int, disparities: int) -> UInt8[np.ndarray, "h w d"]:
    """Zeros, in memory that each thread keeps for its next pair: to have it paged in anew would cost a tenth more."""
    size = height * width * disparities
    if _memory.volume.size < size:
        _memory.volume = np.empty(size, np.uint8)
    volume = _memory.volume[:size].reshape(height, width, disparities)
    volume.fill(0)
    return volume


@cache
def _sweep_for(disparities: int, paths: int) -> Callable:
    """The sweep, compiled for one number of disparities and paths: loops of known length are a seventh faster."""

    @kernel
    def sweep(
        left, right, volume, result, path_costs, floors, downwards, first_step, last_step, completes, matching
    ):  # fmt: skip
        """Steps `first_step` to `last_step`, in rows from where the sweep began: store sums, or complete those stored.

        Lines are numbered: 0 the row, then a column each, then a diagonal each that moves right, then left. A diagonal
        that leaves the image hands its number to the one that enters on the other side.
        """
        height, width, _ = volume.shape
        cost = np.empty(disparities, np.uint8)
        sums = np.zeros(disparities, np.uint8)
        totals = np.empty(width * disparities, np.uint16)
        winners = np.empty(width, np.int64)
        right_best = np.empty(width + disparities, np.uint16)
        lines = np.zeros(paths // 2, np.int64)
        for step in range(first_step, last_step):
            y = step if downwards else height - 1 - step
            left_row, right_row, stored = left[y].reshape(-1), right[y].reshape(-1), volume[y].reshape(-1)
            right_best[:] = WORST_TOTAL
            begin_line(path_costs, floors, 0, disparities)
            for along in range(width):
                x = along if downwards else width - 1 - along
                lines[1] = 1 + x
                if paths == 8:
                    lines[2] = 1 + width + (x - step) % width
                    lines[3] = 1 + 2 * width + (x + step) % width
                    if x == 0:
                        begin_line(path_costs, floors, lines[2], disparities)
                    if x == width - 1:
                        begin_line(path_costs, floors, lines[3], disparities)
                matching_cost(left_row, right_row, x, cost, disparities)
                here = x * disparities
                if completes:
                    for line in lines:
                        advance(path_costs, floors, line, cost, sums, 0, disparities, matching)
                    winners[x] = complete(cost, stored, here, sums, totals, right_best, x, disparities, paths)
                else:
                    for line in lines:
                        advance(path_costs, floors, line, cost, stored, here, disparities, matching)
            if completes:
                row_disparities(winners, totals, right_best, disparities, matching, result[y])

    return sweep
