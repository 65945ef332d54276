"""Targets that no arm of the kind can follow are refused."""

import numpy as np
import pytest

from breastscan.errors import RobotError
from breastscan.robot.ur import targets
from breastscan.robot.ur.ur5e import SPEED_LIMIT

PERIOD = 0.002


@pytest.mark.parametrize("angle", [np.nan, np.inf, 6.3])
def test_angles_beyond_the_joints_are_refused(angle):
    q = np.zeros(6)
    q[3] = angle
    with pytest.raises(RobotError, match="unwind"):
        targets.check_angles(q)


def test_a_step_at_full_speed_passes_and_a_faster_one_is_refused():
    full = SPEED_LIMIT * PERIOD
    targets.check_step(np.full(6, full), np.zeros(6), PERIOD)
    with pytest.raises(RobotError, match="move_joint first"):
        targets.check_step(np.full(6, 1.1 * full), np.zeros(6), PERIOD)


@pytest.mark.parametrize(
    ("speed", "acceleration"), [(0.0, 1.0), (-1.0, 1.0), (4.0, 1.0), (1.0, 0.0)]
)
def test_a_motion_needs_a_speed_and_an_acceleration(speed, acceleration):
    with pytest.raises(RobotError, match="move_joint needs"):
        targets.check_motion(speed, acceleration)
