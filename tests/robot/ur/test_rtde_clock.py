"""The twin's clock and its client: one that waits gives a run again, one that runs on is met."""

import time

import numpy as np
import pytest

from breastscan import execution
from breastscan.control.contact import ContactConfig
from breastscan.control.phases import PhaseConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import ConfigError, RobotError
from breastscan.robot.ur.rtde_robot import RtdeConfig, RtdeRobot
from breastscan.robot.ur.worker import LinkLimits
from sim.controller.fault_injection import TwinControl
from sim.robot import SimRobot
from sim.scene import Scene
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from sim.wrist.probe import payload
from tests.robot.contract import RobotContract, send
from tests.sim.controller.served import address, served
from tests.twin_path import arc_motion

HOST = address(32)
CONFIG = ContactConfig(force=5.0, phases=PhaseConfig(approach_speed=0.02, settle_time=0.6))
ERRORS = ("--scene.wrist.quality", "ur5e_builtin", "--scene.breathing.amplitude", "0.003")
SILENCE_DETECTED = 0.2
"""Most that may pass from a controller's end to its error [s]."""


@pytest.fixture(scope="module")
def scene():
    return Scene()


def connect(scene, slack=1.0):
    tool = payload(scene.config.mount_angle)
    return RtdeRobot(
        RtdeConfig(host=HOST, X_FP=scene.X_FP, payload=tool, limits=LinkLimits(slack=slack))
    )


def test_two_scans_in_lockstep_are_equal_to_the_last_bit_from_the_tare_on(scene):
    """With noise, drift and breath, though one twin has been waiting for a second longer."""
    tissue = SoftTissue.build(scene.phantom)
    motion = arc_motion(scene, Truth(scene.phantom, tissue), length=0.01)
    # loads every kernel here: the twin waits for two seconds only
    execution.execute(SimRobot(scene, tissue), motion, CONFIG, SafetyLimits())

    def scanned(waiting):
        with served(HOST, *ERRORS):
            time.sleep(waiting)
            robot = connect(scene)
            log = execution.execute(robot, motion, CONFIG, SafetyLimits())
            robot.close()
        return np.array([[*sample.q, *sample.qd, *sample.wrench_P] for sample in log])

    first, second = scanned(0.0), scanned(1.0)
    np.testing.assert_array_equal(first, second)


CLOCKS = ["lockstep", pytest.param("real-time", marks=pytest.mark.realtime)]


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_controller_that_is_killed_is_told_and_a_new_one_is_taken_over(scene, clock):
    with served(HOST, clock=clock) as process:
        robot = connect(scene)
        still = robot.state().q
        send(robot, [still] * 100)
        process.kill()
        killed = time.monotonic()
        with pytest.raises(RobotError, match=r"connection to the controller is lost|silence"):
            while time.monotonic() < killed + 5:
                robot.servo_joint(still)
        told = time.monotonic()
        with pytest.raises(RobotError, match="nothing answers there"):
            robot.reconnect()
    if clock == "real-time":  # a dead twin has no other clock
        assert told - killed < SILENCE_DETECTED


@pytest.fixture(scope="module")
def in_real_time(scene):
    with served(HOST, clock="real-time"):
        robot = connect(scene, slack=3.0)  # as docs/hardware.md says of a busy computer
        yield robot
        robot.close()


@pytest.mark.realtime
class TestRtdeRobotInRealTime(RobotContract):
    # a clock goes on while a busy computer misses a period, and the motion is slower by as much
    CLOCK_SLACK = 0.1
    LAG_SLACK = 0.004

    @pytest.fixture
    def robot(self, in_real_time):
        return in_real_time


@pytest.mark.realtime
def test_one_command_goes_out_a_period_in_real_time(in_real_time):
    twin, still = TwinControl(HOST), in_real_time.state().q
    send(in_real_time, [still] * 20)
    twin.do("reset")
    send(in_real_time, [still] * 500)
    none, one, more = twin.do("status")["cycles"]
    twin.close()
    assert one > 0.9 * (none + one + more)


def test_one_number_widens_every_limit_of_the_link():
    wide, limits = LinkLimits(slack=3.0), SafetyLimits()
    assert (wide.lateness, wide.watchdog) == pytest.approx((0.06, 0.09))
    widened = limits.with_slack(3.0)
    assert widened.lateness == pytest.approx(3 * limits.lateness)
    assert widened.silence == pytest.approx(3 * limits.silence)
    assert widened.frozen_time == pytest.approx(3 * limits.frozen_time)
    assert widened.force == limits.force


@pytest.mark.parametrize("slack", [0.5, 11.0, float("nan")])
def test_limits_are_neither_narrower_than_a_quiet_machine_needs_nor_wider_than_control_bears(slack):
    with pytest.raises(ConfigError, match="slack"):
        LinkLimits(slack=slack)
