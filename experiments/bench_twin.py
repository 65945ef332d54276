# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""How much faster than real time does the twin run, pressing the soft phantom under control, and where does it go?"""

import time
from collections.abc import Callable
from unittest.mock import patch

import mujoco
import numpy as np

from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.execution import ScanMotion, execute
from breastscan.geometry import se3
from breastscan.planning import feedrate, joint_path
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.joint_path import JointPathConfig
from breastscan.planning.pattern import Path
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene
from sim.tissue.soft import SoftTissue
from sim.truth import Truth

LOOP_POINTS = 15
REAL_TIME = 4.0
"""Simulated seconds a second of computing that a parameter study needs."""
ALL = 100.0

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """Simulated seconds a second of CPU time on one core, and the shares of what is computed in it."""
    scene = Scene()
    tissue = SoftTissue.build(scene.phantom)
    motion = true_loop_motion(scene, tissue, SimRobot(scene, tissue))
    robot, mechanics, contact = SimRobot(scene, tissue), _Stopwatch(), _Stopwatch()
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
    shares = {
        "mj_step": mechanics.spent,
        "contact": contact.spent,
        "Python outside both": whole - mechanics.spent - contact.spent,
    }
    return [
        ("simulated seconds a CPU second: arm, contact, control at 500 Hz", factor, REAL_TIME, factor / REAL_TIME),
        *((f"of that time, {name} [%]", ALL * spent / whole, ALL, whole / spent) for name, spent in shares.items()),
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


def true_loop_motion(scene: Scene, tissue: SoftTissue, robot: SimRobot) -> ScanMotion:
    """The motion around the true half-height loop: no cameras needed."""
    truth = Truth(scene.phantom, tissue)
    loop_S = truth.half_height_loop()
    points_S, normals_S = truth.closest(loop_S[:: len(loop_S) // LOOP_POINTS][:LOOP_POINTS])
    path = Path(points_B=se3.transform(scene.X_BS, points_S), normals_B=se3.rotate(scene.X_BS, normals_S))
    feed = feedrate.interpolate(path.curve, FeedrateLimits(), robot.period)
    config = JointPathConfig()
    joints = joint_path.plan(feed.positions, path.normals(feed.u), robot.X_FP, robot.period, config)
    return ScanMotion(
        q=joints.q, qd=joints.qd, s=feed.s, q_approach=joints.q_approach, clearance=config.clearance,
        q_home=np.array(HOME_Q),
    )  # fmt: skip
