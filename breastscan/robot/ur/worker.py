"""The process that talks to the controller: one command and one published state every 2 ms.

It is paced by the controller's clock. A new state is published and its parent woken; the parent's
next target arrives as a message, and goes out within the same period. Without one, the latest
target is repeated, which keeps the watchdog quiet. Whatever goes wrong ends the commands, and the
fault is published with the states that still come.

Time is the controller's, as its states tell it, so that a simulated one may stand still for as
long as this machine is busy elsewhere. A real one's runs on by itself: what it says has passed has
passed for the arm. Should its states end, nothing tells the time any more, and nothing is sent
either, since each package answers a state: the controller's own watchdog then brings the arm to
rest. `GONE_TIME` only bounds how late that is told.
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
from breastscan.robot.payload import Payload
from breastscan.robot.ur import faults
from breastscan.robot.ur.faults import TRANSIENT, Fault
from breastscan.robot.ur.priority import ask_for_priority
from breastscan.robot.ur.rtde import Link, Reading
from breastscan.robot.ur.shared_state import ControllerState, SharedState
from breastscan.robot.ur.ur5e import PERIOD

TARGET = struct.Struct("q6d")
"""A message of the parent: the target's sequence number, and the target [rad]."""
POLL_TIME = 2e-4
"""Between two polls of the library's state, which wakes nobody [s]."""
REPEAT_PERIODS = 2
"""Periods without a target beyond which the last is repeated: one less late is still to come."""
GONE_TIME = 0.5
"""Wall time without a state after a package, beyond which the controller counts as gone [s]."""
END_TIME = 2
"""To bring the arm to rest and end the program [s]; the library waits without end where nobody
answers."""
MOVING = 1e-5
"""Joint step from one target to the next [rad] beyond which the next is due: 5 mrad/s."""
LATENESS = 0.02
"""Time for which a moving arm's last target is repeated, on a quiet machine [s]: ten periods, in
which a probe at 25 mm/s goes .5 mm."""
STOP_MARGIN = 0.03
"""By how much later the controller stops by itself [s]: of .1 s, half is left to stop in."""
MAX_SLACK = 10.0
"""Widest that the limits may be: at .2 s the force is no longer controlled."""


@dataclass(frozen=True, kw_only=True)
class LinkLimits:
    """For how long a driven arm may be without a new target."""

    slack: float = 1.0
    """Factor on all limits of lateness, the supervisor's too, for a machine that is busy [-]: for
    so many times 20 ms the arm may go on unguided, and the force be out of control."""

    def __post_init__(self) -> None:
        if not 1.0 <= self.slack <= MAX_SLACK:
            why = f"link.slack must lie in 1 .. {MAX_SLACK:g}, got {self.slack}"
            raise ConfigError(why, self.slack)

    @property
    def lateness(self) -> float:
        """Time for which a moving arm's last target is repeated [s]."""
        return self.slack * LATENESS

    @property
    def watchdog(self) -> float:
        """Time without any package after which the controller stops by itself [s]."""
        return self.lateness + STOP_MARGIN


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


def serve(
    setup: WorkerSetup, shared: SharedState, targets: socket.socket, requests: Connection
) -> None:
    """Run until the parent closes its end, or the link is lost; the process then ends without
    destructors.
    """
    # Ctrl-C is the parent's to handle: it retreats first
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if setup.real_time:
        ask_for_priority()
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

    def __init__(
        self, setup: WorkerSetup, shared: SharedState, targets: socket.socket, requests: Connection
    ) -> None:
        """Connect and set the controller up."""
        self.link = Link(setup.host)
        if not self.link.set_tool(setup.tip_F, setup.payload):
            raise RuntimeError("the controller takes neither TCP nor payload")
        self._limits = setup.limits
        self._shared = shared
        self._targets = targets
        self._requests = requests
        self._target: np.ndarray | None = None
        self._number = 0
        self._armed = False
        """Whether the watchdog is: from the first target on. A parked arm may be left alone,
        however busy the computer is with pictures."""
        self._moving = False
        self._fault, self._failed = Fault.NONE, 0.0
        self._reading = self.link.read()
        self._owes = True
        """Whether the latest state has no answer yet, for which a simulated controller may wait."""
        self._targeted = self._sent = self._reading.time
        """When the parent last said something, and the latest package went out, on the controller's
        clock [s]."""
        self._acknowledged = 0
        """Sequence number of the latest target that was sent."""
        self._seen = time.monotonic()
        """When the controller was last there, on the wall's clock [s]."""
        self._sample = 0
        self._publish()

    def run(self) -> None:
        """Every period, until the parent goes."""
        while self._listen():
            if self.link.time != self._reading.time:
                self._take(self.link.read())
            elif self._owes and self._target is not None:
                self._note_seen()
            elif self._streaming and self._gone:
                self._fail(Fault.SILENCE)
            if not self.link.connected:
                self._fail(Fault.LOST)
                return
        if self._fault is Fault.NONE:
            signal.alarm(END_TIME)  # ends the process, whatever the library waits for
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
                done = getattr(self, name)(*arguments)
                self._targeted = self._sent = self.link.time
                self._note_seen()
                self._requests.send(done)
        except (EOFError, OSError):
            return False
        return True

    def _follow(self, number: int, *q: float) -> None:
        """Send a target of the parent's, with the next state if this one has its answer."""
        if not self._armed:
            self._armed = self.link.arm_watchdog(1 / self._limits.watchdog)
            if not self._armed:
                self._fail(self._diagnosis(self.link.read()) or Fault.REFUSED)
        target = np.array(q)
        self._moving = self._target is not None and bool(
            np.abs(target - self._target).max() > MOVING
        )
        self._target = target
        self._number = number
        self._targeted = self._reading.time
        if self._owes:
            self._command()

    @property
    def _idle(self) -> int:
        """Periods of the controller since the latest target."""
        return round((self._reading.time - self._targeted) / PERIOD)

    @property
    def _streaming(self) -> bool:
        """Whether targets are coming; between two motions they are not, and a silence may end
        unnoticed.
        """
        return self._target is not None and self._idle * PERIOD <= self._limits.lateness

    @property
    def _gone(self) -> bool:
        return time.monotonic() - self._seen > GONE_TIME

    def _command(self) -> None:
        """One package to the controller, unless there is a fault; the first refusal is the last
        command.
        """
        if self._fault not in (Fault.NONE, Fault.LATE):
            return
        taken = self.link.feed_watchdog() if self._target is None else self.link.servo(self._target)
        if taken:
            self._sent = self._reading.time
            self._acknowledged = self._number
            self._owes = False
            self._note_seen()
        else:
            reading = self.link.read()
            self._fail(self._diagnosis(reading) or Fault.REFUSED)

    def _take(self, reading: Reading) -> None:
        """A new state has come."""
        self._sample += reading.raw_wrench != self._reading.raw_wrench
        self._reading = reading
        self._seen = time.monotonic()
        self._owes = True
        self._fail(self._diagnosis(reading))
        if self._idle * PERIOD > self._limits.lateness and self._moving:
            self._fail(Fault.LATE)
        self._publish()
        if self._number > self._acknowledged or self._idle > REPEAT_PERIODS:
            self._command()

    def _note_seen(self) -> None:
        self._seen = time.monotonic()
        self._shared.note_seen(self._seen)

    def _diagnosis(self, reading: Reading) -> Fault:
        found = faults.diagnose(reading.safety_bits, reading.runtime_state)
        if found is Fault.PROGRAM and reading.time - self._sent > self._limits.watchdog:
            return Fault.WATCHDOG
        return found

    def _fail(self, fault: Fault) -> None:
        """Note a fault; one that does not pass by itself stays the reason."""
        if fault is not Fault.NONE and fault is not self._fault and self._fault in TRANSIENT:
            self._fault = fault
            self._failed = self._reading.time
            self._moving = False
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
                acknowledged=self._acknowledged,
                fault=self._fault,
                failed=self._failed if self._fault is not Fault.NONE else reading.time,
                seen=self._seen,
            )
        )
        # a parent that is busy elsewhere finds the state when it looks; one that is gone is missed
        # in `_listen`
        with suppress(BlockingIOError, ConnectionError):
            self._targets.send(b"\0", socket.MSG_DONTWAIT)

    def clear(self) -> bool:
        """Take commands again after a fault that passed; False where it did not."""
        if self._fault in TRANSIENT and not self._gone:
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
