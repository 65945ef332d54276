"""A controller that is not the one, or not ready, is refused before anything moves, with the
cure.
"""

import socketserver
import struct
import threading
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from breastscan.errors import RobotError
from breastscan.robot.ur import preflight
from breastscan.robot.ur.ur5e import DASHBOARD_PORT, RTDE_PORT

HOST = "127.0.0.41"
READY = {
    "get robot model": "UR5",
    "get serial number": "20245500001",
    "robotmode": "Robotmode: RUNNING",
    "safetymode": "Safetymode: NORMAL",
    "is in remote control": "true",
}


class Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True


@contextmanager
def listening(port, handle):
    class Handler(socketserver.StreamRequestHandler):
        def handle(self):
            handle(self.rfile, self.wfile)

    with Server((HOST, port), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield
        server.shutdown()
        thread.join()


@contextmanager
def controller(version=(5, 22, 0, 0), reply=None, dashboard=True, **answers):
    """Answers as a controller does that is ready, but for what is told otherwise."""

    def rtde(asked, told):
        asked.read(3)
        told.write(struct.pack(">HB4I", 19, ord("v"), *version) if reply is None else reply)

    def questions(asked, told):
        told.write(b"Connected: Universal Robots Dashboard Server\n")
        told.flush()
        for line in asked:
            told.write((READY | answers)[line.decode().strip()].encode() + b"\n")

    with ExitStack() as stack:
        stack.enter_context(listening(RTDE_PORT, rtde))
        if dashboard:
            stack.enter_context(listening(DASHBOARD_PORT, questions))
        yield


def test_a_ur5e_that_is_ready_passes_and_is_told_by_its_serial_number():
    with controller():
        found = preflight.examine(HOST)
    assert (found.model, found.serial, found.version) == ("UR5", "20245500001", (5, 22, 0, 0))


def test_software_without_a_dashboard_passes_by_its_version():
    with controller(version=(10, 11, 0, 0), dashboard=False):
        assert preflight.examine(HOST).serial == ""


@pytest.mark.parametrize(
    ("question", "answer", "cure"),
    [
        ("get robot model", "UR10", "expected a UR5e"),
        ("robotmode", "Robotmode: POWER_OFF", "power it on"),
        ("safetymode", "Safetymode: PROTECTIVE_STOP", "clear the stop"),
        ("is in remote control", "false", "remote control is off"),
    ],
)
def test_a_controller_that_is_not_ready_is_refused_with_the_cure(question, answer, cure):
    with controller(**{question: answer}), pytest.raises(RobotError, match=cure):
        preflight.examine(HOST)


def test_software_of_an_older_arm_is_refused():
    with (
        controller(version=(3, 15, 0, 0)),
        pytest.raises(RobotError, match=r"3\.15\.0\.0.*older UR5"),
    ):
        preflight.examine(HOST)


def test_something_else_behind_the_port_is_no_controller():
    with (
        controller(reply=b"HTTP/1.1 400 Bad Request\r\n"),
        pytest.raises(RobotError, match="no UR controller"),
    ):
        preflight.examine(HOST)


def test_a_closed_port_is_told():
    with pytest.raises(RobotError, match="no controller answers"):
        preflight.examine("127.0.0.42")


def test_a_name_that_is_nobodys_is_told():
    with pytest.raises(RobotError, match="there is no host"):
        preflight.examine("no-such-robot.invalid")


def test_a_dashboard_that_is_closed_is_told():
    with (
        controller(dashboard=False),
        pytest.raises(RobotError, match="dashboard server is allowed"),
    ):
        preflight.examine(HOST)


class Standing:
    """An arm that says where its slider stands and what its sensor reads after a tare."""

    def __init__(self, speed_fraction=1.0, force=0.0):
        self.speed_fraction = speed_fraction
        self.force = force
        self.tared = False

    def tare(self):
        self.tared = True

    def state(self):
        assert self.tared
        return SimpleNamespace(wrench_P=np.array([0.0, self.force, 0.0, 0.0, 0.0, 0.0]))


def test_a_slider_that_is_not_up_is_refused():
    preflight.require_full_speed(Standing(1.0))
    with pytest.raises(RobotError, match="80%"):
        preflight.require_full_speed(Standing(0.8))


@pytest.mark.parametrize("force", [3.1, float("nan")])
def test_a_sensor_that_reads_something_in_the_air_is_refused(force):
    preflight.require_plausible_sensor(Standing(force=2.9))
    with pytest.raises(RobotError, match="force sensor reads"):
        preflight.require_plausible_sensor(Standing(force=force))
