"""A controller without its sockets, and programs run on it to their end."""

from dataclasses import dataclass

import numpy as np

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller import functions
from sim.controller.config import ControllerConfig
from sim.controller.states import Runtime, Safety
from sim.robot import SimRobot

START_Q = np.array([0.0, -1.4, 1.6, -1.77, -1.57, 0.0])
"""Over the table, far from singularities [rad]."""
CONFIG = ControllerConfig()


def switched_on(scene, q=START_Q, tissue=None, config=CONFIG, **options):
    robot = SimRobot(scene, tissue, np.array(q))
    return functions.switched_on(robot, config, scene.config.mount_angle, **options)


@dataclass
class Course:
    """What the tool was commanded to do, period by period."""

    p_B: np.ndarray
    """[m]"""
    X_BT: np.ndarray
    v_B: np.ndarray
    """[m/s]"""
    t: float
    """What the program took [s]."""

    @property
    def speed(self):
        return np.linalg.norm(self.v_B, axis=1)


def run_to_end(controller, body, longest=20.0, every_period=lambda: None):
    """Run a program until it ends; what the arm did."""
    controller.run(f"def main():\n{body}\nend")
    while controller._loading:
        controller.cycle()
    poses, speeds = [], []
    while controller.runtime is not Runtime.STOPPED and len(poses) * PERIOD < longest:
        every_period()
        poses.append(controller.tool_pose(controller.robot.commanded[0]))
        speeds.append(controller.tool_speed(*controller.robot.commanded)[:3])
        controller.cycle()
    assert not controller.program_error
    assert controller.safety is Safety.NORMAL
    assert controller.runtime is Runtime.STOPPED
    X_BT = np.array(poses).reshape(-1, 4, 4)
    return Course(X_BT[:, :3, 3], X_BT, np.array(speeds).reshape(-1, 3), len(poses) * PERIOD)


def refusal(controller, body, longest=5.0):
    """Why a program is refused, or ended."""
    controller.run(f"def main():\n{body}\nend")
    for _ in range(round(longest / PERIOD)):
        controller.cycle()
        if controller.program_error:
            return controller.program_error
    raise AssertionError("it was not")
