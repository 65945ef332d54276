"""The twin on the network, driven by the unmodified client library: the contract, and every way to
be stopped.

Times are told on the twin's clock, which waits for its client.
"""

import multiprocessing
import os
import signal
import time

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.phases import Phase, PhaseConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import RobotError
from breastscan.robot.ur.faults import Fault
from breastscan.robot.ur.rtde_robot import RtdeConfig, RtdeRobot
from breastscan.robot.ur.worker import END_TIME
from sim.controller.fault_injection import TwinControl
from sim.scene import Scene
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from sim.wrist.probe import payload
from tests.robot.contract import RobotContract, send
from tests.sim.controller.served import address, ask_dashboard, pass_time, served
from tests.twin_path import arc_motion

HOST = address(31)
CONFIG = ContactConfig(force=5.0, phases=PhaseConfig(approach_speed=0.02, settle_time=0.6))
LIMITS = SafetyLimits()
HIGHEST_FORCE = 15.0
DETECTED, SILENCE_DETECTED = 0.05, 0.2
"""Most that may pass from a fault to its error [s]."""
PASSES_AFTER = {Fault.PROTECTIVE_STOP: 5.5, Fault.SILENCE: 3.5}
"""When a controller lets a fault be cleared [s]."""
STOPPED = 0.02
"""Joint speed of an arm at rest [rad/s]."""
ON_THE_LOOP = 40
"""Row of the plan beyond which faults set in."""


@pytest.fixture(scope="module")
def served_twin():
    with served(HOST) as process:
        yield process


@pytest.fixture(scope="module")
def twin(served_twin):
    return TwinControl(HOST)


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture(scope="module")
def motion(scene):
    return arc_motion(scene, Truth(scene.phantom, SoftTissue.build(scene.phantom)), length=0.02)


def setup(scene, host=HOST):
    return RtdeConfig(host=host, X_FP=scene.X_FP, payload=payload(scene.config.mount_angle))


@pytest.fixture(scope="module")
def connected(twin, scene):
    robot = RtdeRobot(setup(scene))
    yield robot
    robot.close()


class TestRtdeRobot(RobotContract):
    @pytest.fixture
    def robot(self, connected):
        return connected


def test_the_wrench_is_the_twins_own_after_a_tare(connected, twin):
    connected.tare()
    still = [connected.state().q] * 100
    force_P = np.mean([state.wrench_P[:3] for state in send(connected, still)], axis=0)
    assert np.linalg.norm(force_P) < 0.1


def test_one_command_goes_out_a_period(connected, twin):
    still = connected.state().q
    send(connected, [still] * 20)
    twin.do("reset")
    send(connected, [still] * 500)
    assert twin.do("status")["cycles"] == [0, 500, 0]


def test_a_late_parent_is_waited_for(connected, twin):
    connected.move_joint(RobotContract.Q_START, 0.5, 1.0)
    moving = connected.state().q + np.outer(np.arange(100) * 2e-4, np.ones(6))
    send(connected, moving[:50])
    before = connected.state().time
    time.sleep(0.3)
    connected.servo_joint(moving[50])
    assert connected.state().time - before == pytest.approx(connected.period, abs=1e-9)
    connected.stop()


def test_a_parent_that_is_late_finds_the_arm_at_rest_and_may_go_on(connected, twin):
    connected.move_joint(RobotContract.Q_START, 0.5, 1.0)
    moving = connected.state().q + np.outer(np.arange(100) * 2e-4, np.ones(6))
    send(connected, moving)
    pass_time(twin, 0.3)
    with pytest.raises(RobotError, match="no new target came in time") as caught:
        connected.servo_joint(moving[-1])
    assert caught.value.value is Fault.LATE
    connected.stop()
    assert np.abs(connected.state().qd).max() < STOPPED
    send(connected, [moving[-1]] * 10)


def test_an_arm_that_is_led_by_hand_takes_no_targets_until_that_is_ended(connected):
    connected.move_joint(RobotContract.Q_START, 0.5, 1.0)
    connected.freedrive(True)
    with pytest.raises(RobotError, match=r"led by hand.*freedrive\(False\)"):
        connected.servo_joint(connected.state().q)
    with pytest.raises(RobotError, match="led by hand"):
        connected.move_joint(RobotContract.Q_START, 0.5, 1.0)
    connected.freedrive(False)
    connected.move_joint(RobotContract.Q_START + 0.05, 0.5, 1.0)
    np.testing.assert_allclose(connected.state().q, RobotContract.Q_START + 0.05, atol=1e-3)


def test_digital_outputs_reach_the_controller(connected, twin):
    connected.set_digital_output(3, True)
    pass_time(twin, 0.1)
    assert twin.do("status")["digital_outputs"] >> 3 & 1


def test_a_second_client_is_told_that_the_registers_are_in_use(connected, scene):
    with pytest.raises(RobotError, match="another client or a fieldbus holds its RTDE registers"):
        RtdeRobot(setup(scene))


def test_an_address_where_nothing_listens_is_told(scene):
    with pytest.raises(RobotError, match="nothing answers there"):
        RtdeRobot(setup(scene, "127.0.0.99"))


class Trap:
    """A robot under which a fault is sprung on the loop; knows the twin's time when it is told."""

    def __init__(self, robot, log, spring, twin):
        self._robot = robot
        self._log = log
        self._spring = spring
        self._twin = twin
        self.sprung = self.raised = None

    @property
    def _now(self):
        return self._twin.do("status")["time"]

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def servo_joint(self, q):
        if self.sprung is None and scan_log.last_row(self._log) > ON_THE_LOOP:
            self.sprung = self._now
            self._spring()
        try:
            self._robot.servo_joint(q)
        except RobotError:
            if self.raised is None:
                self.raised = self._robot._shared.read().failed
            raise


def pause_worker(twin, robot):
    """Swap the worker out for longer than the controller's watchdog waits."""
    os.kill(robot._process.pid, signal.SIGSTOP)
    pass_time(twin, 0.06)
    os.kill(robot._process.pid, signal.SIGCONT)


def recover(twin, robot):
    twin.do("release")
    ask_dashboard(HOST, "unlock protective stop", "power on", "brake release")
    pass_time(twin, 0.5)  # an arm is powered by steps
    robot.reconnect()


FAULTS = {
    "protective stop": (
        lambda twin, robot: twin.do("protective_stop"),
        Fault.PROTECTIVE_STOP,
        DETECTED,
    ),
    "emergency stop": (
        lambda twin, robot: twin.do("emergency_stop"),
        Fault.EMERGENCY_STOP,
        DETECTED,
    ),
    "program not running": (lambda twin, robot: twin.do("script_error"), Fault.PROGRAM, DETECTED),
    "silence": (
        lambda twin, robot: twin.do("silence", seconds=3.0),
        Fault.SILENCE,
        SILENCE_DETECTED,
    ),
    "connection to the controller is lost": (
        lambda twin, robot: twin.do("close_connections"),
        Fault.LOST,
        DETECTED,
    ),
    "worker died": (
        lambda twin, robot: os.kill(robot._process.pid, signal.SIGKILL),
        Fault.DIED,
        DETECTED,
    ),
    "watchdog": (pause_worker, Fault.WATCHDOG, 0.06 + DETECTED),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_in_contact_is_told_at_once_the_arm_rests_and_the_scan_resumes_where_it_was(
    name, connected, twin, motion
):
    spring, fault, within = FAULTS[name]
    log = []
    trap = Trap(connected, log, lambda: spring(twin, connected), twin)
    recover(twin, connected)
    connected.move_joint(motion.q_approach, 0.6, 0.8)
    twin.do("reset")
    with pytest.raises(RobotError, match=name) as caught:
        execution.execute(trap, motion, CONFIG, LIMITS, log=log)
    assert caught.value.value is fault or caught.value.value.value is fault
    assert trap.raised - trap.sprung < within
    assert log[-1].time > log[0].time
    assert scan_log.last_row(log) > ON_THE_LOOP
    pass_time(twin, PASSES_AFTER.get(fault, 0.3))
    status = twin.do("status")
    assert np.abs(status["qd"]).max() < STOPPED
    assert status["highest_force"] < HIGHEST_FORCE

    recover(twin, connected)
    rest = execution.execute(connected, motion, CONFIG, LIMITS, start=scan_log.last_row(log))
    rows = [entry.row for entry in rest if entry.phase is Phase.LOOP]
    assert abs(rows[0] - scan_log.last_row(log)) < 5
    assert rows[-1] > len(motion.q) - 5
    assert twin.do("status")["highest_force"] < HIGHEST_FORCE


def hold_on(host, scene_config, started):
    """Stream a motion until killed."""
    robot = RtdeRobot(RtdeConfig(host=host, X_FP=scene_config[0], payload=scene_config[1]))
    q = robot.state().q
    for k in range(5000):
        robot.servo_joint(q + 2e-4 * k * np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
        if k == 200:
            started.set()


@pytest.fixture
def child(connected, scene):
    """A scan's process that streams, and its own children; nobody else is connected."""
    connected.close()
    context = multiprocessing.get_context("spawn")
    started = context.Event()
    arguments = (HOST, (scene.X_FP, payload(scene.config.mount_angle)), started)
    process = context.Process(target=hold_on, args=arguments)
    process.start()
    assert started.wait(120)
    workers = [
        int(pid) for pid in os.listdir("/proc") if pid.isdigit() and _parent(pid) == process.pid
    ]
    yield process, workers
    connected.reconnect()


def test_an_arm_whose_clients_are_all_killed_stops_within_a_tenth_of_a_second(twin, child):
    process, workers = child
    killed = twin.do("status")["time"]
    for pid in (*workers, process.pid):
        os.kill(pid, signal.SIGKILL)
    process.join()
    while (status := twin.do("status"))["time"] < killed + 0.1:
        time.sleep(0.005)
    assert np.abs(status["qd"]).max() < STOPPED


def test_nothing_of_a_killed_scan_goes_on_where_the_controller_says_no_more(served_twin, child):
    process, workers = child
    os.kill(served_twin.pid, signal.SIGSTOP)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    until = time.monotonic() + 2 * END_TIME
    while (left := [pid for pid in workers if _is_running(pid)]) and time.monotonic() < until:
        time.sleep(0.05)
    os.kill(served_twin.pid, signal.SIGCONT)
    assert not left


def _is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _parent(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return int(stat.read().rpartition(")")[2].split()[1])
    except OSError:
        return None
