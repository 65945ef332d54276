"""What a scan with a robot refuses before anything moves."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from breastscan.commands import scan_robot
from breastscan.commands.scan_robot import RobotScan
from breastscan.errors import CalibrationError, ConfigError, RobotError, SafetyError
from breastscan.robot.payload import Payload
from breastscan.robot.ur.rtde_robot import RtdeConfig
from breastscan.scan import ScanConfig
from sim.scene import Scene

NOBODY = "127.0.0.43"


def no_camera():
    raise AssertionError("nothing may be looked at")


def run(tmp_path, setup):
    return scan_robot.run(tmp_path / "out", setup, no_camera, ScanConfig(), {}, Console(quiet=True))


@pytest.fixture(scope="module")
def setup():
    payload = Payload(mass=0.4, centre_F=np.zeros(3))
    return RobotScan(robot=RtdeConfig(host=NOBODY, X_FP=np.eye(4), payload=payload), rig=Scene().rig, consent=True)


@pytest.mark.parametrize(("option", "host"), [("rtde://127.0.0.1", "127.0.0.1"), ("rtde://arm.cell", "arm.cell")])
def test_the_host_stands_after_the_scheme(option, host):
    assert scan_robot.host_of(option) == host


@pytest.mark.parametrize("option", ["127.0.0.1", "rtde://", "rtde://arm:30004", "http://arm", "rtde://arm/x"])
def test_a_robot_of_another_form_is_refused(option):
    with pytest.raises(ConfigError, match="rtde://HOST"):
        scan_robot.host_of(option)


def test_a_rig_without_hand_eye_is_refused_first(tmp_path, setup):
    with pytest.raises(CalibrationError, match="handeye"):
        run(tmp_path, replace(setup, rig=replace(setup.rig, X_BL=None)))


def test_nobody_to_agree_is_a_refusal(tmp_path, setup):
    with pytest.raises(SafetyError, match="--yes"):
        run(tmp_path, replace(setup, consent=False))


def test_no_controller_is_told_and_leaves_nothing_behind(tmp_path, setup):
    with pytest.raises(RobotError, match="no controller answers"):
        run(tmp_path, setup)
    assert not (tmp_path / "out").exists()
