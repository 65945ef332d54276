"""A UR5e on the network as a `Robot`: the real arm, or the twin as a controller.

The library that speaks to it lives in a process of its own (`worker`), which may crash without
taking the scan along. Every fault is told as a `RobotError` with its cure, at the next command,
within a period of being seen. Nothing reconnects by itself: `reconnect` does, in a new process,
once the fault's cause is gone.
"""

import math
import multiprocessing
import select
import socket
import time
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.interface import RobotState
from breastscan.robot.joint_motion import braking, trapezoid
from breastscan.robot.payload import Payload
from breastscan.robot.ur import faults, targets
from breastscan.robot.ur.faults import Fault
from breastscan.robot.ur.shared_state import ControllerState, SharedState
from breastscan.robot.ur.ur5e import PERIOD, SERVO
from breastscan.robot.ur.worker import END_TIME, TARGET, LinkLimits, WorkerSetup, serve

ANSWER_TIME = 0.2
"""Longest wait for the state after a target, on the controller's clock [s]: a busy machine stalls a
simulated controller as well, and a real one has stopped the arm by its watchdog long before."""
HUNG_TIME = 3.0
"""Wall time without a word of the worker, beyond which it hangs [s]: longer than a simulated
controller waits for it. Of a controller that is gone it tells sooner, and a real one has long
stopped the arm."""
START_PERIODS, START_TIME = 10, 0.2
"""Periods in which the controller's program begins to follow a parked arm's place, and wall time in
which all states on their way arrive [s]: from there on each target follows the state it was made
of."""
REQUEST_TIME = 5.0
"""Longest wait for what the worker asks of the controller besides targets [s]."""
CONNECT_TIME = 60.0
"""Longest wait for a new worker: a Python process starts, and the controller is given its program
[s]."""
STOP_DECELERATION = 4.0
"""Deceleration of the leading joint on `stop` [rad/s^2]."""
ARRIVED = 5e-4
"""Joint error within which a motion has arrived [rad]: the encoders' noise stays below."""
RESTS = 0.01
"""Joint speed below which it rests [rad/s]."""
SETTLE_TIME = 1.0
"""Longest wait for a motion to arrive [s]."""
TARE_TIME = 0.2
"""Time over which `tare` averages the sensor's noise [s]."""


@dataclass(frozen=True, kw_only=True)
class RtdeConfig:
    """One controller, and what its arm carries."""

    host: str
    """Name or address of the controller."""
    X_FP: Float[np.ndarray, "4 4"]
    """Pose of the probe tip in the flange [m]; the controller is given it as its TCP."""
    payload: Payload
    """What hangs on the wrist sensor; the controller is given it."""
    limits: LinkLimits = field(default_factory=LinkLimits)
    """When the arm is no longer driven."""
    real_time: bool = True
    """Whether to ask the system for real-time priority."""
    kinematics: KinematicCalibration = field(default_factory=KinematicCalibration.nominal)
    """The arm's own, or those of the drawing, which may be off by millimetres."""


class RtdeRobot:
    """Implements `breastscan.robot.interface.Robot` over RTDE."""

    period = PERIOD
    """Control period [s]."""
    servo = SERVO
    """How the arm follows the targets of `servo_joint`."""

    def __init__(self, config: RtdeConfig) -> None:
        """Connect and take the arm over where it stands.

        Raises:
            RobotError: The controller is not there, or refuses.
        """
        self._config = config
        self.X_FP = config.X_FP
        """Pose of the probe tip in the flange."""
        self.calibration = config.kinematics
        """The arm's kinematics, as configured."""
        self._zero_P = np.zeros(6)
        self._context = multiprocessing.get_context("spawn")
        self._connect()

    def state(self) -> RobotState:
        """The latest sample. Does not wait.

        Raises:
            RobotError: The link is down or the sample is stale.
        """
        return self._as_robot_state(self._require_healthy(self._shared.read()))

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Track `q` [rad] for one period, and return when the state after it is there.

        Raises:
            RobotError: The target is none that an arm follows, or the robot takes no commands: says
                why, and the cure.
        """
        targets.check_angles(q)
        targets.check_step(q, self._target, self.period)
        if self._free:
            raise RobotError("the arm is led by hand: end that first, by freedrive(False)", q)
        self._require_healthy(self._shared.read())
        self._number += 1
        self._driven = True
        try:
            self._targets.send(TARGET.pack(self._number, *q.tolist()))
        except OSError:
            raise self._link_error() from None
        self._before, self._target = self._target, q.copy()
        self._wait_for(self._number)

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Move to `q` [rad] on a straight line in joint space and wait until there.

        The motion is streamed: a moveJ of the controller blocks its program, so the watchdog would
        have to be off for as long.

        Raises:
            RobotError: The target is out of reach, speed or acceleration are not positive, the
                robot stopped, or the arm does not arrive.
        """
        targets.check_angles(q)
        targets.check_motion(speed, acceleration)
        self._recover()
        self._start()
        self._brake()
        for target in trapezoid(self._target, q, speed, acceleration, self.period):
            self.servo_joint(target)
        self._settle()

    def tare(self) -> None:
        """Hold still for `TARE_TIME` and take the mean wrench as zero: the sensor's own zero first,
        then the rest.

        Raises:
            RobotError: The robot stopped.
        """
        self._request("zero_sensor")
        self._zero_P = np.zeros(6)
        wrenches = []
        for _ in range(round(TARE_TIME / self.period)):
            self._hold()
            wrenches.append(self.state().wrench_P)
        self._zero_P = np.mean(wrenches, axis=0)

    def stop(self) -> None:
        """Brake along the commanded motion and stay there. Where no command is taken, the
        controller has stopped it.
        """
        with suppress(RobotError):
            self._recover()
            self._brake()
            self._settle()

    def freedrive(self, on: bool) -> None:
        """Let the arm be led by hand, to teach it a pose, or end that where it then is.

        Raises:
            RobotError: The robot refused.
        """
        self._request("freedrive", on)
        self._free = on
        self._park()

    def set_digital_output(self, number: int, on: bool) -> None:
        """Switch one of the controller's eight standard outputs.

        Raises:
            RobotError: The robot refused.
        """
        self._request("set_digital_output", number, on)

    def reconnect(self) -> None:
        """Take the arm over anew where it stands, by a new process, after a fault's cause is gone.
        The tare stays.

        Raises:
            RobotError: The controller is not there, or refuses.
        """
        self.close()
        self._connect()

    def close(self) -> None:
        """Bring the arm to rest, end the program on the controller, and disconnect."""
        self._targets.close()
        self._requests.close()
        self._process.join(END_TIME)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _connect(self) -> None:
        self._shared = SharedState(self._context)
        self._targets, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._requests, their_requests = self._context.Pipe()
        setup = WorkerSetup(
            host=self._config.host,
            tip_F=se3.pose_vector(self.X_FP).tolist(),
            payload=self._config.payload,
            limits=self._config.limits,
            real_time=self._config.real_time,
        )
        self._process = self._context.Process(
            target=serve,
            args=(setup, self._shared, theirs, their_requests),
            name="breastscan-rtde",
            daemon=True,
        )
        self._process.start()
        theirs.close()
        their_requests.close()
        self._number = 0
        self._free = False
        """Whether the arm is led by hand."""
        self.speed_fraction = float(self._await_worker())
        """Where the speed slider stood on connecting, 0 to 1."""
        self._park()

    def _await_worker(self) -> float:
        """What a worker says once it is ready."""
        try:
            told = (
                self._requests.recv()
                if self._requests.poll(CONNECT_TIME)
                else TimeoutError("no answer")
            )
        except EOFError as error:
            told = error
        if isinstance(told, float):
            return told
        self.close()
        raise RobotError(
            f"cannot take over the robot at {self._config.host}: {_reason(told)}", told
        )

    def _stand_at(self, q: Float[np.ndarray, "6"]) -> None:
        """Go on from rest at `q` [rad]."""
        self._target = self._before = q

    def _park(self) -> None:
        """Leave the arm alone, where it stands."""
        self._driven = False
        self._stand_at(self.state().q)

    def _start(self) -> None:
        """Have the controller's program follow a parked arm's place, before the arm moves."""
        if not self._driven:
            for _ in range(START_PERIODS):
                self.servo_joint(self._target)
            time.sleep(START_TIME)

    def _hold(self) -> None:
        """One period at rest; a parked arm is left alone."""
        if self._driven:
            self.servo_joint(self._target)
        else:
            self._wait_for(self._number, after=self.state().time)

    def _request(self, name: str, *arguments: object) -> bool:
        """Have the worker do what takes longer than a period.

        Raises:
            RobotError: The robot refused, or the worker is gone.
        """
        try:
            self._requests.send((name, *arguments))
            if not self._requests.poll(REQUEST_TIME):
                raise RobotError(
                    f"the controller does not answer to {name!r}: read the pendant's log", name
                )
            done = self._requests.recv()
        except (EOFError, OSError):
            raise self._link_error() from None
        if not done:
            self._require_healthy(self._shared.read())
            raise RobotError(f"the controller refused {name!r}: read the pendant's log", name)
        return True

    def _recover(self) -> None:
        """Have commands taken again after a fault that has passed; the arm then rests at the latest
        target.

        Raises:
            RobotError: The fault has not passed.
        """
        fault = self._shared.read().fault
        if fault is not Fault.NONE and fault in faults.TRANSIENT:
            self._request("clear")
            self._stand_at(self._target)

    def _brake(self) -> None:
        speed = (self._target - self._before) / self.period
        for q in braking(self._target, speed, STOP_DECELERATION, self.period):
            self.servo_joint(q)

    def _settle(self) -> None:
        """Hold the joints' place until they are there."""
        error, target = math.inf, self._target
        for _ in range(round(SETTLE_TIME / self.period)):
            self.servo_joint(target)
            state = self._shared.read()
            error = float(np.abs(state.q - target).max())
            if error < ARRIVED and np.abs(state.qd).max() < RESTS:
                return
        raise RobotError(
            f"the arm does not arrive: {error:.4f} rad off after {SETTLE_TIME} s, something holds "
            "it",
            error,
        )

    def _wait_for(self, number: int, after: float = -math.inf) -> None:
        """Until a state came after target `number`, and is newer than `after` on the
        controller's clock [s].
        """
        began = self._shared.read().time
        while (
            state := self._require_healthy(self._shared.read())
        ).acknowledged < number or state.time <= after:
            ready, _, _ = select.select([self._targets], [], [], HUNG_TIME)
            if not ready or state.time > began + ANSWER_TIME:
                raise faults.error(Fault.SILENCE)
            try:
                woken = self._targets.recv(1)
            # a killed worker may leave unread messages, which resets the connection
            except OSError:
                woken = b""
            if not woken:
                raise self._link_error()

    def _require_healthy(self, state: ControllerState) -> ControllerState:
        """The state, if commands are taken after it.

        Raises:
            RobotError: The controller reports a fault, or nothing was heard of it for too long.
        """
        if state.fault is not Fault.NONE:
            raise faults.error(state.fault)
        if time.monotonic() - state.seen > HUNG_TIME:
            raise (
                self._link_error() if not self._process.is_alive() else faults.error(Fault.SILENCE)
            )
        return state

    def _link_error(self) -> RobotError:
        """Why the worker is gone: what it said last, or that it died."""
        fault = self._shared.read().fault
        return faults.error(Fault.DIED if fault in faults.TRANSIENT else fault)

    def _as_robot_state(self, state: ControllerState) -> RobotState:
        R_PB = (self.calibration.forward(state.q)[:3, :3] @ self.X_FP[:3, :3]).T
        wrench_P = (
            np.concatenate([R_PB @ state.force_B[:3], R_PB @ state.force_B[3:]]) - self._zero_P
        )
        return RobotState(
            time=state.time, q=state.q, qd=state.qd, wrench_P=wrench_P, sample=state.sample
        )


REASONS = (
    (
        "registers are already in use",
        "another client or a fieldbus holds its RTDE registers: end it, and disable "
        "EtherNet/IP, PROFINET and MODBUS on the controller",
    ),
    ("remote control", "it is not in remote control: switch it over on the pendant, top right"),
    (
        "Could not connect",
        "nothing answers there: check the address, the cable, and that RTDE is allowed under the "
        "controller's Security, Services",
    ),
    (
        "start control script",
        "its program does not start: power the arm on, release the brakes, clear any stop on the "
        "pendant, and switch to remote control",
    ),
)
"""What the library's messages contain, and what they mean."""


def _reason(told: BaseException) -> str:
    text = str(told) or type(told).__name__
    return next((meaning for words, meaning in REASONS if words.lower() in text.lower()), text)
