"""A robot that takes every command and moves nothing."""

import numpy as np

from breastscan.robot.interface import Robot
from breastscan.robot.standing import StandingRobot
from tests.springs import SpringRobot


def test_commands_pass_periods_and_move_nothing():
    arm = SpringRobot(np.full(6, 0.3), height=0.0, late=2)
    standing = StandingRobot(arm)
    before = standing.state()
    standing.servo_joint(np.ones(6))
    standing.move_joint(np.ones(6), 1.0, 1.0)
    standing.tare()
    standing.stop()
    after = standing.state()
    assert isinstance(standing, Robot)
    assert standing.servo == arm.servo
    assert (after.time - before.time, after.sample - before.sample) == (arm.period, 1)
    np.testing.assert_array_equal(after.q, before.q)
    np.testing.assert_array_equal(arm.q, np.full(6, 0.3))
    assert arm.time == 0.0
