"""Semi-global matching [Zhang, Eqs. 4-7]: exact path costs over the whole image, 32 disparities at
a time.

Two sweeps cross the image, one downwards and one upwards, each with the paths that come from behind
it: along its row, straight, and along both diagonals. They start together and store, over their
first half, the matching costs and what their paths add to them (8 bit: one path adds P2 at most).
They meet at half height, and each completes the half that the other has stored: to load the
matching costs is faster than to count bits again.
"""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from breastscan.vision.matching.lanes import LANES
from breastscan.vision.matching.sgm_kernels import NO_PATH, Matching
from breastscan.vision.matching.sgm_sweep import sweep_for

CACHE_LINE = 64
"""[bytes]"""


def semi_global_disparity(
    left: UInt8[np.ndarray, "h 8 w_left"],
    right: UInt8[np.ndarray, "h 8 w_right"],
    result: Float32[np.ndarray, "h width"],
    *,
    disparities: int,
    paths: int,
    matching: Matching,
) -> None:
    """Disparity of the left pixels [px], NaN where the right image disagrees or the winner ends the
    range.

    Args:
        left: Census planes of the left pixels. Those columns are matched that the smallest
            disparity does not carry off the right image.
        right: Census planes of the right pixels, continued to the left; column x + e is compared
            with the x-th matched left column at index e.
        result: Is filled; one column for each that is matched.
        disparities: Number of disparities, a multiple of `LANES`.
        paths: 8, or 4 for rows and columns only.
        matching: Penalties, consistency and sub-pixel fit.
    """
    height, width = result.shape
    half = height // 2
    increments, costs = _kept_volumes(height, width, disparities)
    fronts = _Fronts.at_rest(width, disparities, paths)

    def run(downwards: bool, first_step: int, last_step: int, completes: bool) -> None:
        side = int(downwards)
        sweep_for(disparities, paths, completes)(
            left,
            right,
            increments,
            costs,
            result,
            fronts.path_costs[side],
            fronts.minima[side],
            downwards,
            first_step,
            last_step,
            matching,
        )

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(run, (True, False), (0, 0), (half, height - half), (False, False)))
        list(pool.map(run, (True, False), (half, height - half), (height, height), (True, True)))


class _Memory(threading.local):
    volumes = np.empty(0, np.uint8)


_memory = _Memory()


def _kept_volumes(height: int, width: int, disparities: int) -> UInt8[np.ndarray, "2 h w_d"]:
    """Two bytes a pixel and disparity, in memory that each thread keeps: paging it in anew would
    cost a tenth more.
    """
    shape = (2, height, width * disparities)
    if _memory.volumes.size < np.prod(shape):
        _memory.volumes = _aligned_zeros(shape).ravel()
    return _memory.volumes[: np.prod(shape)].reshape(shape)


@dataclass(frozen=True, kw_only=True)
class _Fronts:
    """What `Front` takes: for both sweeps the row behind and the row at hand, which change
    places at every step.
    """

    path_costs: UInt8[np.ndarray, "2 2 n"]
    minima: UInt8[np.ndarray, "2 2 slots"]

    @staticmethod
    def at_rest(width: int, disparities: int, paths: int) -> "_Fronts":
        """No line has begun."""
        slots = (paths // 2 - 1) * (width + 2)
        path_costs = _aligned_zeros((2, 2, 1 + slots, disparities + LANES))
        # the first slot holds no costs, only what precedes those of the next
        path_costs[..., disparities:] = NO_PATH
        return _Fronts(
            path_costs=path_costs.reshape(2, 2, -1)[..., disparities:],
            minima=np.zeros((2, 2, slots), np.uint8),
        )


def _aligned_zeros(shape: tuple[int, ...]) -> UInt8[np.ndarray, "*shape"]:
    """Zeros that begin at a cache line: vectors that straddle two lines take twice as long."""
    size = int(np.prod(shape))
    memory = np.zeros(size + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + size].reshape(shape)
