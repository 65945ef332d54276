"""How many pixels are wrong at sharp depth edges, against OpenCV's matcher: in a synthetic room and
on photographs?

Of the pixels that are matched, and of all once holes are filled from the background. OpenCV's
eight-path mode rejects ambiguous matches as its own sample does. Left columns that no full search
reaches are left out for both.

`python -m experiments.bench_edges FOLDER ...` measures Middlebury's pairs in these folders as well.
"""

import sys
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32

from breastscan.errors import BreastScanError
from breastscan.vision.stereo import StereoConfig, disparity_map, disparity_range
from experiments import real_pairs
from experiments.bench_depth import Row
from experiments.depth_edges import EdgePair, edge_pair
from experiments.opencv_stereo import opencv_disparity

NOISES = (1.0, 3.0)
"""Of the synthetic room, standard deviations [grey levels]."""
ERRORS_PX = (0.5, 1.0, 2.0)


def rows(folders: tuple[Path, ...] = ()) -> list[Row]:
    """The synthetic room, the photographed pair that pip can fetch, and those in `folders`."""
    table = []
    for noise in NOISES:
        table += pair_rows(f"synthetic room, noise {noise:.0f}", edge_pair(noise=noise))
    try:
        table += pair_rows("photograph Motorcycle", real_pairs.motorcycle())
    except BreastScanError as error:
        print(f"Photograph left out: {error}")
    for folder in folders:
        table += pair_rows(f"photograph {folder.name}", real_pairs.middlebury(folder))
    return table


def pair_rows(name: str, pair: EdgePair) -> list[Row]:
    """Wrong pixels [%] of a pair, over the range of disparities that the coarse pass finds."""
    searched = disparity_range(pair.left, pair.right, StereoConfig())
    assert searched is not None
    smallest, count = searched
    table = []
    peer = wrong_percent(
        opencv_disparity(pair.left, pair.right, smallest, count), pair, smallest + count
    )
    for paths in (8, 4):
        config = StereoConfig(
            min_disparity=smallest, num_disparities=count, paths=8 if paths == 8 else 4
        )
        own = wrong_percent(disparity_map(pair.left, pair.right, config), pair, smallest + count)
        table += [
            (
                f"{name}, {paths} paths, {what} [%]",
                own[what],
                peer[what],
                peer[what] / max(own[what], 1e-9),
            )
            for what in own
        ]
    return table


def wrong_percent(
    disparity: Float32[np.ndarray, "h w"], pair: EdgePair, reach: int
) -> dict[str, float]:
    """Fractions of pixels off by more than each of `ERRORS_PX`, without the `reach` columns on the
    left [%].
    """
    searched = np.isfinite(pair.disparity)
    searched[:, :reach] = False
    known = searched & pair.seen_twice & np.isfinite(disparity)

    def percent(
        estimate: Float[np.ndarray, "h w"], where: Bool[np.ndarray, "h w"], limit: float
    ) -> float:
        return float(100 * np.mean(np.abs(estimate - pair.disparity)[where] > limit))

    filled = filled_from_background(disparity)
    return {
        f"off by {limit} px, matched": percent(disparity, known, limit) for limit in ERRORS_PX
    } | {f"off by {limit} px, filled": percent(filled, searched, limit) for limit in ERRORS_PX}


def filled_from_background(disparity: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Every hole takes the smaller of the nearest known disparities left and right of it: the
    surface behind.
    """
    filled = disparity.copy()
    for row in filled:
        known = np.flatnonzero(np.isfinite(row))
        if len(known):
            holes = np.flatnonzero(np.isnan(row))
            after = np.searchsorted(known, holes)
            right = row[known[np.minimum(after, len(known) - 1)]]
            left = row[known[np.maximum(after - 1, 0)]]
            row[holes] = np.minimum(left, right)
    return filled


if __name__ == "__main__":
    for what, own, peer, ratio in rows(tuple(Path(folder) for folder in sys.argv[1:])):
        print(f"{what:60s} {own:8.3f} {peer:8.3f} {ratio:6.2f}x")
