"""ur_rtde behind a narrow class: the only file that imports it, and only inside the worker process.

The client library crashes or lies after a lost connection (its own reconnecting ends in a
segmentation fault, servoJ returns True on a dead link), so nothing here reconnects, and the process
that holds a `Link` ends without running its destructors. Only calls whose answers can be trusted
are used.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from breastscan.robot.payload import Payload
from breastscan.robot.ur.ur5e import PERIOD, SERVO

STOP_DECELERATION = 2.0
"""Of servoStop, at the tip [m/s^2]."""
READY_STATES = 4
"""States after a call that was waited for, until the program is ready for the next. A command sent
sooner waits inside the library, in a loop that never sleeps and can keep the library's own receiver
from ever seeing the program ready."""
READY_TIME = 0.1
"""Longest wait for them on the wall's clock [s]: a simulated controller may stand still until it
has an answer. On the controller's own clock, by which its watchdog counts, they are 8 ms."""
VARIABLES = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_TCP_force",
    "runtime_state",
    "safety_status_bits",
    "robot_mode",
    "target_speed_fraction",
    "ft_raw_wrench",
    "robot_status_bits",
    "output_int_register_2",
)
"""What is asked of the controller: less than the library's default, which costs both ends ten times
as much."""


@dataclass(frozen=True)
class Reading:
    """What the controller says of one instant."""

    time: float
    """Its clock [s]."""
    q: list[float]
    """[rad]"""
    qd: list[float]
    """[rad/s]"""
    force_B: list[float]
    """On the TCP, in the axes of the base, force first [N, N m]."""
    raw_wrench: list[float]
    """The sensor's own reading [N, N m]."""
    runtime_state: int
    safety_bits: int


class Link:
    """Connections to one controller, on which the library's program runs."""

    def __init__(self, host: str) -> None:
        """Connect, and send the program.

        Raises:
            RuntimeError: The library's: not there, registers in use, no remote control, program
                does not start.
        """
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface

        self._host = host
        self._receive = RTDEReceiveInterface(host, 1 / PERIOD, list(VARIABLES))
        self._control = RTDEControlInterface(host, 1 / PERIOD)
        self._outputs = None

    @property
    def connected(self) -> bool:
        """Whether both connections stand."""
        return self._receive.isConnected() and self._control.isConnected()

    @property
    def time(self) -> float:
        """Controller's clock at the latest state [s]."""
        return self._receive.getTimestamp()

    @property
    def speed_fraction(self) -> float:
        """Where the speed slider stands, 0 to 1."""
        return self._receive.getTargetSpeedFraction()

    def read(self) -> Reading:
        """The latest state, all of it of one instant."""
        while True:
            now, receive = self.time, self._receive
            reading = Reading(
                now, receive.getActualQ(), receive.getActualQd(), receive.getActualTCPForce(),
                receive.getFtRawWrench(), receive.getRuntimeState(), receive.getSafetyStatusBits(),
            )  # fmt: skip
            if self.time == now:
                return reading

    def servo(self, q: np.ndarray) -> bool:
        """Send a joint target [rad]; False where the controller's program takes none."""
        return self._control.servoJ(q.tolist(), 0.0, 0.0, PERIOD, SERVO.lookahead_time, SERVO.gain)

    def feed_watchdog(self) -> bool:
        """Feed the watchdog without a command."""
        return self._control.kickWatchdog()

    def arm_watchdog(self, frequency: float) -> bool:
        """Have the controller stop by itself once it hears nothing for 1 / `frequency` [Hz]."""
        return self._waited(self._control.setWatchdog, frequency)

    def set_tool(self, tip_F: list[float], payload: Payload) -> bool:
        """Tell the controller the tip's pose in the flange, as position and rotation vector, and
        what hangs there.
        """
        return self._waited(self._control.setTcp, tip_F) and self._waited(
            self._control.setPayload, payload.mass, payload.centre_F.tolist()
        )

    def zero_sensor(self) -> bool:
        """Take the sensor's present reading as zero."""
        return self._waited(self._control.zeroFtSensor)

    def freedrive(self, on: bool) -> bool:
        """Let the arm be led by hand, or end that."""
        return self._waited(self._control.freedriveMode if on else self._control.endFreedriveMode)

    def set_digital_output(self, number: int, on: bool) -> bool:
        """Switch one of the eight standard outputs."""
        if self._outputs is None:
            from rtde_io import RTDEIOInterface

            self._outputs = RTDEIOInterface(self._host)
        return self._outputs.setStandardDigitalOut(number, on)

    def end_servo(self) -> bool:
        """Bring a servoed arm to rest."""
        return self._waited(self._control.servoStop, STOP_DECELERATION)

    def _waited(self, call: Callable[..., bool], *arguments: object) -> bool:
        """Make a call that the library waits for, and wait until the program takes the next."""
        done = call(*arguments)
        before = self.time
        until = time.monotonic() + READY_TIME
        while self.time < before + READY_STATES * PERIOD and time.monotonic() < until:
            time.sleep(0.25 * PERIOD)
        return done

    def end_program(self) -> None:
        """End the program on the controller."""
        self._control.stopScript()
