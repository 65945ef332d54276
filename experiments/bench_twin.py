"""How much faster than real time does the twin run, pressing the soft phantom under control?"""

import time

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
from sim.tissue import SoftTissue
from sim.truth import Truth

LOOP_POINTS = 15
REAL_TIME = 1.0
"""A second of the arm in a second of computing."""

Row = tuple[str, float, float, float]


def rows() -> list[Row]:
    """Simulated seconds a second of CPU time, against real time."""
    scene = Scene()
    tissue = SoftTissue.build(scene.phantom)
    robot = SimRobot(scene, tissue)
    motion = true_loop_motion(scene, tissue, robot)
    start, simulated_from = time.process_time(), robot.state().time
    execute(robot, motion, ContactConfig(), SafetyLimits())
    simulated = robot.state().time - simulated_from
    factor = simulated / (time.process_time() - start)
    return [("simulated seconds a CPU second: arm, contact, control at 500 Hz", factor, REAL_TIME, factor)]


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
