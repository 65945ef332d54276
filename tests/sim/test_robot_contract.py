"""The twin keeps the contract of every robot."""

import pytest

from sim.robot import SimRobot
from sim.scene import Scene
from tests.robot.contract import RobotContract


@pytest.fixture(scope="module")
def scene():
    return Scene()


class TestSimRobot(RobotContract):
    @pytest.fixture
    def robot(self, scene):
        return SimRobot(scene)
