"""The process that talks to the controller: one command and one published state every 2 ms.

It is paced by the controller's clock. A new state is published and its parent woken; the parent's next target arrives
as a message, and goes out within the same period. Without one, the latest target is repeated, which keeps the
watchdog quiet. Whatever goes wrong ends the commands, and the fault is published with the states that still come.
"""

import os
import select
import signal
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from breastscan.errors import ConfigError
from breastscan.robot import faults
from breastscan.robot.faults import PASSING, Fault
from breastscan.robot.payload import Payload
from breastscan.robot.rtde import FREQUENCY, Link, Reading
from breastscan.robot.shared_state import ControllerState, SharedState

TARGET = struct.Struct("q6d")
"""A message of the parent: the target's number, and the target [rad]."""
POLL_TIME = 2e-4
"""Between two looks at the library's state, which wakes nobody [s]."""
REPEAT_PERIODS = 2
"""Periods without a target from which on the last one is repeated: a target that is late by less is still to come."""
MOVING = 1e-5
"""Joint step from one target to the next [rad] beyond which the next is due: 5 mrad/s."""
PERIOD = 1 / FREQUENCY
"""Of the controller [s]."""
LONGEST = 0.2
"""Longest that a limit may be [s]: the arm is under force control meanwhile."""
PRIORITY = 20
"""Real-time priority that is asked for."""


@dataclass(frozen=True, kw_only=True)
class LinkLimits:
    """How long either end may say nothing while the arm is driven."""

    silence: float = 0.02
    """Age at which the controller's latest state is a fault [s]: ten periods, in which a probe at 25 mm/s goes
    .5 mm."""
    lateness: float = 0.02
    """Time for which a moving arm's last target is repeated [s]."""
    watchdog: float = 0.05
    """Time after which the controller stops by itself [s]: of a tenth of a second, half is left to stop in."""

    def __post_init__(self) -> None:
        for name in ("silence", "lateness", "watchdog"):
            value = getattr(self, name)
            if not PERIOD < value <= LONGEST:
                raise ConfigError(f"link.{name} must lie in {PERIOD} .. {LONGEST} s, got {value} s", value)


@dataclass(frozen=True, kw_only=True)
class WorkerSetup:
    """What the worker is to connect to."""

    host: str
    """Name or address of the controller."""
    tip_F: list[float]
    """Pose of the probe tip in the flange: position [m] and rotation vector [rad]."""
    payload: Payload
    """What hangs on the wrist sensor."""
    real_time: bool
    """Whether to ask for real-time priority."""
    limits: LinkLimits
    """When the arm is no longer driven."""


def serve(setup: WorkerSetup, shared: SharedState, targets: socket.socket, requests: Connection) -> None:
    """Run until the parent closes its end, or the link is lost; the process then ends without destructors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle: it retreats first
    if setup.real_time:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    try:
        worker = Worker(setup, shared, targets, requests)
    except RuntimeError as error:
        requests.send(error)
        os._exit(1)
    requests.send(worker.link.speed_fraction)
    worker.run()
    os._exit(0)


class Worker:
    """The cycle and what it remembers."""

    def __init__(self, setup: WorkerSetup, shared: SharedState, targets: socket.socket, requests: Connection) -> None:
        """Connect and set the controller up."""
        self.link = Link(setup.host)
        if not self.link.set_tool(setup.tip_F, setup.payload):
            raise RuntimeError("the controller takes neither TCP nor payload")
        self._limits = setup.limits
        self._shared, self._targets, self._requests = shared, targets, requests
        self._target: np.ndarray | None = None
        self._number = 0
        self._armed = False
        """Whether the watchdog is: from the first target on. A parked arm may be left alone, however busy the computer
        is with pictures."""
        self._moving = False
        self._idle = 0
        """States since the latest target."""
        self._fault = Fault.NONE
        self._reading = self.link.read()
        self._seen = self._sent = time.monotonic()
        self._sample = 0
        self._publish()

    def run(self) -> None:
        """Every period, until the parent goes."""
        while self._listen():
            if self.link.time != self._reading.time:
                self._take(self.link.read())
            elif self._streaming and time.monotonic() - self._seen > self._limits.silence:
                self._fail(Fault.SILENCE)
            if not self.link.connected:
                self._fail(Fault.LOST)
                return
        if self._fault is Fault.NONE:
            if self._target is not None:
                self.link.end_servo()
            self.link.end_program()

    def _listen(self) -> bool:
        """Wait a moment for the parent; False once it is gone."""
        ready, _, _ = select.select([self._targets, self._requests], [], [], POLL_TIME)
        try:
            if self._targets in ready:
                message = self._targets.recv(TARGET.size)
                if not message:
                    return False
                self._follow(*TARGET.unpack(message))
            if self._requests in ready:
                name, *arguments = self._requests.recv()
                self._requests.send(getattr(self, name)(*arguments))
                self._sent = time.monotonic()
        except (EOFError, OSError):
            return False
        return True

    def _follow(self, number: int, *q: float) -> None:
        """Send a target of the parent's."""
        if not self._armed:
            self._armed = self.link.arm_watchdog(1 / self._limits.watchdog)
            if not self._armed:
                self._fail(self._diagnosis(self.link.read()) or Fault.REFUSED)
        target = np.array(q)
        self._moving = self._target is not None and bool(np.abs(target - self._target).max() > MOVING)
        self._target, self._number, self._idle = target, number, 0
        self._command()

    @property
    def _streaming(self) -> bool:
        """Whether targets are coming; between two motions they are not, and a silence may end unnoticed."""
        return self._target is not None and self._idle * PERIOD <= self._limits.lateness

    def _command(self) -> None:
        """One package to the controller, unless there is a fault; the first refusal is the last command."""
        if self._fault not in (Fault.NONE, Fault.LATE):
            return
        taken = self.link.kick() if self._target is None else self.link.servo(self._target)
        if taken:
            self._sent = time.monotonic()
        else:
            reading = self.link.read()
            self._fail(self._diagnosis(reading) or Fault.REFUSED)

    def _take(self, reading: Reading) -> None:
        """A new state has come."""
        self._sample += reading.raw_wrench != self._reading.raw_wrench
        self._reading, self._seen = reading, time.monotonic()
        self._fail(self._diagnosis(reading))
        self._idle += 1
        if self._idle * PERIOD > self._limits.lateness and self._moving:
            self._fail(Fault.LATE)
        if self._idle > REPEAT_PERIODS:
            self._command()
        self._publish()

    def _diagnosis(self, reading: Reading) -> Fault:
        found = faults.diagnose(reading.safety_bits, reading.runtime_state)
        if found is Fault.PROGRAM and time.monotonic() - self._sent > self._limits.watchdog:
            return Fault.WATCHDOG
        return found

    def _fail(self, fault: Fault) -> None:
        """Note a fault; one that does not pass by itself stays the reason."""
        if fault is not Fault.NONE and fault is not self._fault and self._fault in PASSING:
            self._fault, self._moving = fault, False
            self._publish()

    def _publish(self) -> None:
        reading = self._reading
        self._shared.write(
            ControllerState(
                time=reading.time,
                q=np.array(reading.q),
                qd=np.array(reading.qd),
                force_B=np.array(reading.force_B),
                sample=self._sample,
                answers=self._number,
                fault=self._fault,
                seen=self._seen,
            )
        )
        with suppress(BlockingIOError):  # a parent that is busy elsewhere finds the state when it looks
            self._targets.send(b"\0", socket.MSG_DONTWAIT)

    def clear(self) -> bool:
        """Take commands again after a fault that passed; False where it did not."""
        stale = time.monotonic() - self._seen > self._limits.silence
        if self._fault in PASSING and not stale:
            self._fault, self._moving = Fault.NONE, False
            self._publish()
        return self._fault is Fault.NONE

    def zero_sensor(self) -> bool:
        """Have the controller take the present wrench as zero."""
        return self.link.zero_sensor()

    def freedrive(self, on: bool) -> bool:
        """Let the arm be led by hand, or end that."""
        if self._target is not None and not self.link.end_servo():
            return False
        self._target = None
        return self.link.freedrive(on)

    def set_digital_output(self, number: int, on: bool) -> bool:
        """Switch a standard digital output."""
        return self.link.set_digital_output(number, on)
