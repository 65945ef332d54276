"""What does a control cycle with safety cost? Everything between two calls of the robot, over a
scan on the twin.
"""

import time
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.execution import execute
from breastscan.robot.interface import Robot
from experiments.bench_twin import Row
from experiments.sections import section
from sim.robot import SimRobot
from sim.scene import Scene
from sim.tissue.soft import SoftTissue
from sim.true_loop import true_loop_motion

LENGTH, SPEED = 0.15, 0.025
"""Of the path that is walked [m, m/s]."""
MEDIAN_BUDGET, LATE_BUDGET = 0.25e-3, 1e-3
"""Of a cycle of 2 ms, which the robot's own link needs as well [s]."""
LATE = 0.999
"""Quantile that counts as the worst case."""


class _Clocked:
    """A robot whose calls stop a clock: what runs on is the controller's own time."""

    def __init__(self, robot: SimRobot) -> None:
        self._robot = robot
        self._left = time.thread_time()
        self.cycles: list[float] = []
        """CPU time of each cycle [s]."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot, name)

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Pass a command on; the cycle ends with it."""
        self.cycles.append(time.thread_time() - self._left)
        self._robot.servo_joint(q)
        self._left = time.thread_time()


def cycle_times() -> Float[np.ndarray, "n"]:
    """CPU time of every cycle of a short scan [s]."""
    scene = Scene()
    tissue = SoftTissue.build(scene.phantom)
    robot = SimRobot(scene, tissue)
    motion = section(
        true_loop_motion(scene, tissue), robot.X_FP, start=0.0, length=LENGTH, speed=SPEED
    )
    clocked = _Clocked(robot)
    execute(cast(Robot, clocked), motion, ContactConfig(), SafetyLimits())
    return np.array(clocked.cycles[1:])


def rows() -> list[Row]:
    """Median and worst case, against what a cycle of 2 ms leaves."""
    cycles = cycle_times()
    median, late = (float(np.quantile(cycles, fraction)) for fraction in (0.5, LATE))
    return [
        (
            "control cycle with safety, CPU time, median [ms]",
            median * 1e3,
            MEDIAN_BUDGET * 1e3,
            MEDIAN_BUDGET / median,
        ),
        ("the same, 99.9 % [ms]", late * 1e3, LATE_BUDGET * 1e3, LATE_BUDGET / late),
    ]
