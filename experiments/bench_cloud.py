"""How much CPU time do sampling and normals of a cloud take, and how much do Open3D's take?"""

import time
from collections.abc import Callable

import numpy as np

from breastscan.cloud.filters import uniform_sample
from breastscan.cloud.normals import estimate_normals
from experiments.peers import peer

POINTS = 200_000
SAMPLES = 2_000
NEIGHBOURS = 15
GROWTH = 12.0
"""Times that sampling may take with ten times as many points."""
REPEATS = 3
"""Each time is the minimum of so many."""

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """What was timed, own CPU time of all threads [s], the peer's or the budget [s], and peer over
    own.
    """
    clouds = {"a surface": _surface(POINTS), "a volume": _volume(POINTS)}
    found = [_growth_row(name, points) for name, points in clouds.items()]
    open3d = peer("open3d")
    if open3d is not None:
        for name, points in clouds.items():
            found += _peer_rows(open3d, name, points)
    return found


def _surface(count: int) -> np.ndarray:
    """A hill of 50 mm on a square of 200 mm [m]."""
    x, y = np.random.default_rng(0).uniform(-0.1, 0.1, (2, count))
    return np.stack([x, y, 0.5 - 0.05 * np.exp(-(x**2 + y**2) / 0.05**2)], axis=-1)


def _volume(count: int) -> np.ndarray:
    """Anywhere in a cube of 200 mm [m]."""
    return np.random.default_rng(0).uniform(0.0, 0.2, (count, 3))


def _growth_row(name: str, points: np.ndarray) -> Row:
    few, all_of = _cpu_seconds(
        lambda: uniform_sample(points[::10], SAMPLES), lambda: uniform_sample(points, SAMPLES)
    )
    what = f"{SAMPLES} of {POINTS} points of {name}, against {GROWTH:g} times those of a tenth"
    return what, all_of, GROWTH * few, GROWTH * few / all_of


def _peer_rows(open3d, name: str, points: np.ndarray) -> list[Row]:
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    nearest = open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)
    sampling = _cpu_seconds(
        lambda: uniform_sample(points, SAMPLES), lambda: cloud.farthest_point_down_sample(SAMPLES)
    )
    normals = _cpu_seconds(
        lambda: estimate_normals(points, k=NEIGHBOURS),
        # a cloud that has normals already turns the new ones towards them
        lambda: open3d.geometry.PointCloud(cloud.points).estimate_normals(nearest),
    )
    return [
        (f"{SAMPLES} of {POINTS} points of {name}, against Open3D", *_compared(*sampling)),
        (f"normals of {POINTS} points of {name}, against Open3D", *_compared(*normals)),
    ]


def _compared(own: float, other: float) -> tuple[float, float, float]:
    return own, other, other / own


def _cpu_seconds(*works: Callable[[], object]) -> list[float]:
    """Minimum CPU time of a few runs of each, one after the other, after one that compiles."""
    least = [np.inf] * len(works)
    for run in range(REPEATS + 1):
        for i, work in enumerate(works):
            start = time.process_time()
            work()
            if run > 0:
                least[i] = min(least[i], time.process_time() - start)
    return least


if __name__ == "__main__":
    for what, own, other, ratio in rows():
        print(f"{what:80} {own:10.3g} s {other:10.3g} s {ratio:8.3g}x")
