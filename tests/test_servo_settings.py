"""A scan of the twin with another servo than the nominal one: the controller goes by what the robot
reports.
"""

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import SafetyError
from sim.arm.servo import ServoConfig
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from tests.twin_path import arc_motion

SETTINGS = ServoConfig(gain=300.0)
"""Of an early driver: the servo overshoots, damped by .26 [UR-overshoot]."""


class NominalReport(SimRobot):
    """Reports the nominal servo, whatever its own does."""

    servo = ServoConfig().servo


@pytest.fixture(scope="module")
def scene():
    return Scene(SceneConfig(servo=SETTINGS))


@pytest.fixture(scope="module")
def tissue(scene):
    return SoftTissue.build(scene.phantom)


def scanned(kind, scene, tissue):
    """Forces over the loop of a short scan [N]."""
    motion = arc_motion(scene, Truth(scene.phantom, tissue), length=0.03)
    tissue.reset()
    robot = kind(scene, tissue, motion.q_approach)
    log = execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    table = scan_log.trajectory(log, motion, robot)
    return table.pressing_force[table.in_loop]


def test_force_is_held_on_a_servo_of_little_gain_because_the_robot_says_so(scene, tissue):
    forces = scanned(SimRobot, scene, tissue)
    assert np.sqrt(np.mean((forces - 5.0) ** 2)) < 0.2


def test_a_model_of_another_gain_swings_until_the_supervisor_ends_it(scene, tissue):
    with pytest.raises(SafetyError, match="contact force"):
        scanned(NominalReport, scene, tissue)
