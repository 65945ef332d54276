"""How fast is the stereo matcher, and how exact, against OpenCV's on the same pair?

Speed is CPU time (all threads, on one core) at the rig's full size, the median of interleaved runs,
so that a busy machine slows both alike; both keep their memory between runs. `bench_depth` and
`bench_edges` tell how exact.
"""

import os
import time
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Bool

from breastscan.cloud.segment import segment_breast
from breastscan.vision.camera import RectifiedPair
from breastscan.vision.refine import refine
from breastscan.vision.stereo import StereoConfig, disparity_map
from breastscan.vision.triangulation import triangulate
from experiments import bench_depth, bench_edges
from experiments.bench_depth import Row
from experiments.opencv_stereo import opencv_matcher
from experiments.ray_cast_dome import DomeScene

OPENCV_MODES = {
    "StereoSGBM, 5 paths": cv2.StereoSGBM_MODE_SGBM,
    "StereoSGBM HH, 8 paths": cv2.StereoSGBM_MODE_HH,
    "StereoSGBM 3WAY, 3 paths": cv2.StereoSGBM_MODE_SGBM_3WAY,
}
REGION_BUDGET = 0.06
"""CPU time from the breast's part of a pair to refined depth [s]."""
REGION_MARGIN = 8
"""Pixels of that part around the breast."""
MEMORY_BUDGET_MIB = 1024.0
MIB = 2**20


@dataclass(frozen=True, kw_only=True)
class BenchConfig:
    """What is run and how often."""

    scene: DomeScene = field(default_factory=lambda: DomeScene(width_px=1280, height_px=1024))
    min_disparity: int = 64
    num_disparities: int = 128
    repeats: int = 9
    """Runs of each matcher after one that warms up."""


def rows(config: BenchConfig | None = None) -> list[Row]:
    """Measure speed, memory and exactness."""
    config = config or BenchConfig()
    pair = config.scene.pair()
    return [
        *_speed_rows(pair, config),
        _region_row(pair, config),
        _memory_row(pair, config),
        *bench_depth.rows(),
        *bench_edges.rows(),
    ]


def _speed_rows(pair: RectifiedPair, config: BenchConfig) -> list[Row]:
    own = {f"{paths} paths": _own_matcher(pair, config, paths) for paths in (8, 4)}
    peers = {name: _opencv_matcher(pair, config, mode) for name, mode in OPENCV_MODES.items()}
    seconds = _interleaved_cpu_seconds({**own, **peers}, config.repeats)
    return [
        (
            f"CPU time, {ours} against {theirs} [s]",
            seconds[ours],
            seconds[theirs],
            seconds[theirs] / seconds[ours],
        )
        for ours in own
        for theirs in peers
    ]


def _region_row(pair: RectifiedPair, config: BenchConfig) -> Row:
    """From the part of the pair that shows the breast to its refined disparity, the mask known
    from before.
    """
    mask = segment_breast(triangulate(_own_matcher(pair, config, paths=8)(), pair)).mask
    stereo = StereoConfig(
        min_disparity=config.min_disparity, num_disparities=config.num_disparities
    )
    rows, columns = _region(mask, config.min_disparity + config.num_disparities)
    left, right, part = (
        np.ascontiguousarray(image[rows, columns]) for image in (pair.left, pair.right, mask)
    )

    def run() -> np.ndarray:
        return refine(left, right, disparity_map(left, right, stereo), part).disparity

    seconds = _interleaved_cpu_seconds({"region": run}, config.repeats)["region"]
    return (
        "CPU time, breast region, pair to refined depth [s]",
        seconds,
        REGION_BUDGET,
        REGION_BUDGET / seconds,
    )


def _region(mask: Bool[np.ndarray, "h w"], reach: int) -> tuple[slice, slice]:
    """The breast's rows and columns, and on its left those that its disparities reach."""
    y, x = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(y[0] - REGION_MARGIN, 0), y[-1] + REGION_MARGIN),
        slice(max(x[0] - REGION_MARGIN - reach, 0), x[-1] + REGION_MARGIN),
    )


def _memory_row(pair: RectifiedPair, config: BenchConfig) -> Row:
    """The most that one match takes, in a thread of its own, which has kept no memory from
    earlier ones.
    """
    tracemalloc.start()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(_own_matcher(pair, config, paths=8)).result()
    peak = tracemalloc.get_traced_memory()[1] / MIB
    tracemalloc.stop()
    return "memory of a match, 8 paths [MiB]", peak, MEMORY_BUDGET_MIB, MEMORY_BUDGET_MIB / peak


def _own_matcher(pair: RectifiedPair, config: BenchConfig, paths: int) -> Callable[[], np.ndarray]:
    stereo = StereoConfig(
        min_disparity=config.min_disparity,
        num_disparities=config.num_disparities,
        paths=8 if paths == 8 else 4,
    )
    return lambda: disparity_map(pair.left, pair.right, stereo)


def _opencv_matcher(
    pair: RectifiedPair, config: BenchConfig, mode: int
) -> Callable[[], np.ndarray]:
    matcher = opencv_matcher(config.min_disparity, config.num_disparities, mode)
    return lambda: matcher.compute(pair.left, pair.right)


def _interleaved_cpu_seconds(
    runs: dict[str, Callable[[], np.ndarray]], repeats: int
) -> dict[str, float]:
    """Median CPU time of each, all run in turn `repeats` times after a first round that compiles
    and warms up.
    """
    seconds = {name: [] for name in runs}
    with _one_core():
        for round_ in range(repeats + 1):
            for name, run in runs.items():
                start = time.process_time()
                run()
                if round_ > 0:
                    seconds[name].append(time.process_time() - start)
    return {name: float(np.median(times)) for name, times in seconds.items()}


@contextmanager
def _one_core() -> Iterator[None]:
    """Keep this thread, those that it starts, and OpenCV's on one core.

    Threads that share a core's units wait for each other, and that time would count as theirs.
    """
    threads = cv2.getNumThreads()
    # Linux alone has it
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    cv2.setNumThreads(1)
    if cores is not None:
        os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
        if cores is not None:
            os.sched_setaffinity(0, cores)


if __name__ == "__main__":
    for what, own, peer, ratio in rows():
        print(f"{what:60s} {own:8.3f} {peer:8.3f} {ratio:6.2f}x")
