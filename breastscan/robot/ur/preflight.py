"""Before anything moves: is this the controller it should be, in a state to be driven?

Asked over two of the controller's own services, with sockets of our own: the version over RTDE,
everything else of the dashboard, which software from version 10 on does not have.
"""

import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from breastscan.errors import RobotError
from breastscan.robot.ur.rtde_robot import RtdeConfig, RtdeRobot
from breastscan.robot.ur.ur5e import (
    DASHBOARD_PORT,
    MODEL,
    OLDEST_SOFTWARE,
    RTDE_PORT,
    WITHOUT_DASHBOARD,
)

ANSWER_TIME = 2.5
"""Longest wait for an answer [s]."""
FULL_SPEED = 0.999
"""Where the speed slider counts as fully up."""
PLAUSIBLE_FORCE = 3.0
"""Most that a tared sensor may read with nothing touching [N]: the built-in one's precision is 3.5
N in all [UR5e]."""
VERSION_REQUEST = struct.pack(">HB", 3, ord("v"))
"""RTDE message that asks for the controller's version [UR-rtde-guide]."""
VERSION_REPLY = struct.Struct(">HB4I")
"""Size, type, and major, minor, bugfix, build."""


@dataclass(frozen=True, kw_only=True)
class ControllerIdentity:
    """Which controller answered."""

    host: str
    """Its name or address."""
    version: tuple[int, int, int, int]
    """Of its software."""
    model: str
    """As its dashboard says it; empty where it has none."""
    serial: str
    """Serial number; empty where it has no dashboard."""


def examine(host: str) -> ControllerIdentity:
    """Ask a controller who it is, and refuse one that cannot be driven.

    Raises:
        RobotError: Nothing answers, it is no UR5e, or it is not ready: says which, and the cure.
    """
    version = software_version(host)
    if version[0] < OLDEST_SOFTWARE:
        raise RobotError(
            f"the controller at {host} runs software {_dotted(version)}, expected "
            f"{OLDEST_SOFTWARE}.0 or newer, which a UR5e has: this is an older UR5, which this "
            "program does not drive",
            version,
        )
    if version[0] >= WITHOUT_DASHBOARD:
        return ControllerIdentity(host=host, version=version, model="", serial="")
    with _dashboard(host) as ask:
        controller = ControllerIdentity(
            host=host,
            version=version,
            model=ask("get robot model"),
            serial=ask("get serial number"),
        )
        if controller.model.upper() not in (MODEL, f"{MODEL}E"):
            raise RobotError(
                f"the robot at {host} is a {controller.model}, expected a UR5e: give another "
                "address with --robot",
                controller.model,
            )
        _require_ready(ask, host)
    return controller


@contextmanager
def opened(link: RtdeConfig) -> Iterator[RtdeRobot]:
    """The robot at the other end of a link, once everything that can be refused beforehand is not;
    it is let go in the end.

    Raises:
        RobotError: It is not there, not the one expected, or not ready: says which, and the cure.
    """
    examine(link.host)
    with closing(RtdeRobot(link)) as robot:
        require_full_speed(robot)
        require_plausible_sensor(robot)
        yield robot


def require_full_speed(robot: RtdeRobot) -> None:
    """Refuse an arm whose speed slider is not fully up.

    Raises:
        RobotError: It is not.
    """
    if robot.speed_fraction < FULL_SPEED:
        raise RobotError(
            f"the speed slider stands at {robot.speed_fraction:.0%}, expected 100 %, or the arm "
            "falls behind its path: move it up on the pendant",
            robot.speed_fraction,
        )


def require_plausible_sensor(robot: RtdeRobot) -> None:
    """Tare, in the air, and see that the sensor then reads about nothing.

    Raises:
        RobotError: It does not.
    """
    robot.tare()
    force = float(np.linalg.norm(robot.state().wrench_P[:3]))
    if not force < PLAUSIBLE_FORCE:
        raise RobotError(
            f"the force sensor reads {force:.1f} N just after a tare, expected less than "
            f"{PLAUSIBLE_FORCE:.1f} N: does something touch the probe, or pull its cable?",
            force,
        )


def software_version(host: str) -> tuple[int, int, int, int]:
    """Version of a controller's software.

    Raises:
        RobotError: Nothing answers there, or something else does.
    """
    with _connected(host, RTDE_PORT, "RTDE") as connection:
        try:
            connection.sendall(VERSION_REQUEST)
            reply = _receive(connection, VERSION_REPLY.size)
        except OSError as error:
            raise _no_controller(host, str(error)) from error
    size, kind, *version = (
        VERSION_REPLY.unpack(reply) if len(reply) == VERSION_REPLY.size else (0, 0)
    )
    if size != VERSION_REPLY.size or kind != ord("v"):
        raise _no_controller(host, "it does not tell its version")
    major, minor, bugfix, build = version
    return major, minor, bugfix, build


def _require_ready(ask: Callable[[str], str], host: str) -> None:
    checks = (
        ("robotmode", "RUNNING", "power it on and release the brakes, on the pendant"),
        ("safetymode", "NORMAL", "clear the stop on the pendant, after looking why it came"),
        (
            "is in remote control",
            "TRUE",
            "remote control is off: switch it on, top right on the pendant",
        ),
    )
    for question, expected, cure in checks:
        answer = ask(question)
        if answer.rpartition(":")[2].strip().upper() != expected:
            raise RobotError(
                f"the robot at {host} answers {answer!r} to {question!r}, expected {expected}: "
                f"{cure}",
                answer,
            )


@contextmanager
def _dashboard(host: str) -> Iterator[Callable[[str], str]]:
    """Asks one line, and gives the one that answers."""
    with _connected(host, DASHBOARD_PORT, "dashboard server") as connection:
        lines = connection.makefile("rw", encoding="utf-8", newline="\n")
        lines.readline()  # it greets first

        def ask(question: str) -> str:
            try:
                lines.write(question + "\n")
                lines.flush()
                return lines.readline().strip()
            except OSError as error:
                raise _no_controller(host, f"its dashboard is silent ({error})") from error

        yield ask


def _connected(host: str, port: int, service: str) -> socket.socket:
    try:
        return socket.create_connection((host, port), timeout=ANSWER_TIME)
    except socket.gaierror as error:
        raise RobotError(
            f"there is no host {host!r}: check the name in --robot rtde://HOST", host
        ) from error
    except OSError as error:
        raise RobotError(
            f"no controller answers at {host}, port {port} ({error.strerror or error}): check the "
            f"address and the cable, that the controller is on, and that its {service} is allowed "
            "under Settings, Security, Services",
            host,
        ) from error


def _receive(connection: socket.socket, size: int) -> bytes:
    received = b""
    while len(received) < size:
        more = connection.recv(size - len(received))
        if not more:
            break
        received += more
    return received


def _no_controller(host: str, why: str) -> RobotError:
    return RobotError(
        f"what answers at {host} is no UR controller ({why}): check the address in --robot", host
    )


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))
