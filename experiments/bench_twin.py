# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""How much faster than real time does the twin run, pressing the soft phantom under control, and
where does it go?
"""

import time
from collections.abc import Callable
from unittest.mock import patch

import mujoco

from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.execution import execute
from sim.robot import SimRobot
from sim.scene import Scene
from sim.tissue.soft import SoftTissue
from sim.true_loop import true_loop_motion

REAL_TIME = 4.0
"""Simulated seconds a second of computing that a parameter study needs."""
ALL = 100.0

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """Simulated seconds a second of CPU time on one core, and the fractions of what is computed in
    it.
    """
    scene = Scene()
    tissue = SoftTissue.build(scene.phantom)
    motion = true_loop_motion(scene, tissue)
    robot = SimRobot(scene, tissue)
    mechanics = _Stopwatch()
    contact = _Stopwatch()
    started = robot.state().time
    with (
        patch.object(mujoco, "mj_step1", mechanics.timing(mujoco.mj_step1)),
        patch.object(mujoco, "mj_step2", mechanics.timing(mujoco.mj_step2)),
        patch.object(tissue, "press", contact.timing(tissue.press)),
    ):
        start = time.process_time()
        execute(robot, motion, ContactConfig(), SafetyLimits())
        whole = time.process_time() - start
    factor = (robot.state().time - started) / whole
    fractions = {
        "mj_step": mechanics.spent,
        "contact": contact.spent,
        "Python outside both": whole - mechanics.spent - contact.spent,
    }
    return [
        (
            "simulated seconds a CPU second: arm, contact, control at 500 Hz",
            factor,
            REAL_TIME,
            factor / REAL_TIME,
        ),
        *(
            (f"of that time, {name} [%]", ALL * spent / whole, ALL, whole / spent)
            for name, spent in fractions.items()
        ),
    ]


class _Stopwatch:
    """CPU time spent in some functions [s]."""

    def __init__(self) -> None:
        self.spent = 0.0

    def timing(self, function: Callable) -> Callable:
        """The same function, its time added up."""

        def timed(*arguments: object) -> object:
            start = time.process_time()
            result = function(*arguments)
            self.spent += time.process_time() - start
            return result

        return timed
