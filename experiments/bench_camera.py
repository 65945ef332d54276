"""How long does a pair of camera pictures take without a graphics card: distorted, supersampled,
with every error?
"""

import time
from collections.abc import Callable
from contextlib import closing

from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.scene import Scene, SceneConfig

BUDGET = 1.5
"""CPU time a pair may take [s]."""
ROUNDS = 5

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """CPU time (all threads, the renderer's included) and wall time of a realistic 1280 x 1024
    pair [s].
    """
    with closing(
        SimStereoCamera(Scene(SceneConfig(camera=CameraConfig(quality="realistic"))))
    ) as camera:
        camera.capture()  # the first one compiles shaders
        cpu, wall = (
            _median(camera.capture, clock) for clock in (time.process_time, time.perf_counter)
        )
    what = "camera pair 1280x1024, 2x supersampled, realistic"
    return [
        (f"{what}: CPU s", cpu, BUDGET, BUDGET / cpu),
        (f"{what}: wall s", wall, BUDGET, BUDGET / wall),
    ]


def _median(action: Callable[[], object], clock: Callable[[], float]) -> float:
    times = []
    for _ in range(ROUNDS):
        start = clock()
        action()
        times.append(clock() - start)
    return sorted(times)[ROUNDS // 2]
