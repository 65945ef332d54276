"""Execution: approach, contact, settle, the path under force control, retreat [Zhang, Sec. V-B.2].

Every period the planned probe pose is shifted along its own axis by the depth that the force controller asks for
(`control.contact`), and one Newton step of the inverse kinematics turns the shifted pose into joint targets. The arm
follows its targets late by a known time, so the plan is sent ahead by as much: the arm then is where the plan is.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from breastscan.control import contact, safety
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.safety import SafetyLimits
from breastscan.errors import RobotError, SafetyError
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.interface import Robot, RobotState

TRANSFER_SPEED = 0.6
"""Top joint speed of the free motions to and from the breast [rad/s]."""
TRANSFER_ACCELERATION = 0.8
"""Joint acceleration of the free motions [rad/s^2]."""
EMERGENCY_FACTOR = 2.0
"""How much faster an emergency retreat is than the usual one."""
PROGRESS_EVERY = 250
"""Control periods between two reports of progress."""


@dataclass(frozen=True, kw_only=True)
class ScanMotion:
    """What the arm is to do: the planned path on the skin, one row a control period."""

    q: Float[np.ndarray, "n 6"]
    """Joint angles with the probe tip on the planned skin [rad]."""
    qd: Float[np.ndarray, "n 6"]
    """Their speeds [rad/s]."""
    s: Float[np.ndarray, "n"]
    """Length along the path [m]."""
    q_approach: Float[np.ndarray, "6"]
    """Joint angles with the probe clear of the skin in front of the path's first point [rad]."""
    clearance: float
    """How far in front of it, along the probe axis [m]; the retreat ends as far from the last point."""
    q_home: Float[np.ndarray, "6"]
    """Where the arm parks before and after [rad]."""


@dataclass
class MotionLog:
    """One row a control period, as `trajectory.parquet` holds them (units there)."""

    rows: list[dict] = field(default_factory=list)

    def add(self, phase: str, state: RobotState, target: np.ndarray, index: int | None, touching: bool) -> None:
        """Append the state that followed `target`; `index` is the row of the plan where it should be, None off it."""
        self.rows.append({"phase": phase, "state": state, "target": target, "index": index, "contact": touching})


class _Probe:
    """The probe on its way: sends shifted plan poses to the robot, and remembers how deep and how far it is."""

    def __init__(self, robot: Robot, motion: ScanMotion, config: ContactConfig, limits: SafetyLimits) -> None:
        self.robot, self.motion, self.config, self.limits = robot, motion, config, limits
        self.log = MotionLog()
        self.memory = ContactMemory(depth=-motion.clearance)
        self.lead = round(robot.servo_lag / robot.period)
        """Rows by which the plan is sent ahead of the arm."""
        self.index = 0
        """Row of the plan that is sent."""
        self.target = motion.q_approach.copy()
        self.state = robot.state()
        self.check_interrupt: Callable[[], None] = lambda: None
        """Called before every command; raises where the user has asked for an end."""

    @property
    def force(self) -> float:
        """Measured contact force along the probe axis, positive when pressing [N]."""
        return -float(self.state.wrench_P[2])

    def advance(self, phase: str, speed: float) -> None:
        """One period along the probe axis at `speed` [m/s], positive towards the tissue."""
        self._send(phase, contact.advance(self.memory, self.force, speed, self.config, self.robot.period))

    def regulate(self, phase: str, set_point: float, reached: int | None = None) -> None:
        """One period of force control towards `set_point` [N]; on the path, the arm is at row `reached` of the plan."""
        memory = contact.regulate(self.memory, self.force, set_point, self.config, self.robot.period)
        self._send(phase, memory, reached)

    def _send(self, phase: str, memory: ContactMemory, reached: int | None = None) -> None:
        """One period towards the row `index` of the plan, shifted by the depth in `memory`."""
        self.check_interrupt()
        q_plan = self.motion.q[self.index]
        target = shifted_joints(self.robot.calibration, self.target, q_plan, self.robot.X_FP, memory.depth)
        safety.check_command(target, self.target, self.robot.period, self.limits)
        self.robot.servo_joint(target)
        self.memory, self.target, self.state = memory, target, self.robot.state()
        touching = memory.force > 0.5 * self.config.contact_force
        self.log.add(phase, self.state, target, reached, touching)
        safety.check_wrench(self.state.wrench_P, self.limits)


def shifted_joints(
    calibration: KinematicCalibration,
    q_start: Float[np.ndarray, "6"],
    q_plan: Float[np.ndarray, "6"],
    X_FP: Float[np.ndarray, "4 4"],
    depth: float,
) -> Float[np.ndarray, "6"]:
    """Joint angles that put the tip `depth` [m] along the probe axis beyond where `q_plan` puts it.

    One Newton step from `q_start` [rad]: at 500 Hz the pose moves by less than .1 mm a period, so a step leaves
    an error below a nanometre.
    """
    X_BF = calibration.forward(q_plan)
    X_BF[:3, 3] += X_BF[:3, :3] @ (depth * X_FP[:3, 2])
    return calibration.step(q_start, X_BF)


def execute(
    robot: Robot,
    motion: ScanMotion,
    config: ContactConfig,
    limits: SafetyLimits,
    progress: Callable[[float], None] = lambda share: None,
) -> MotionLog:
    """Run the whole contact scan on a robot, and always leave the skin.

    Args:
        robot: The twin or the real arm.
        motion: What `scan.plan` made.
        config: Force control.
        limits: What ends the scan.
        progress: Told the share of the path that is done, 0 to 1.

    Returns:
        The log of every control period in contact or close to it.

    Raises:
        SafetyError: A limit was passed; the probe was retreated first.
        RobotError: No contact was found, or the robot refused.
        KeyboardInterrupt: The user asked for an end; the probe was retreated first.
    """
    robot.move_joint(motion.q_approach, TRANSFER_SPEED, TRANSFER_ACCELERATION)
    robot.tare()
    probe = _Probe(robot, motion, config, limits)
    with deferred_interrupt() as probe.check_interrupt:
        try:
            _approach(probe)
            _settle(probe)
            _follow_path(probe, progress)
            _retreat(probe)
        except BaseException:
            probe.check_interrupt = lambda: None  # nothing ends the retreat half-way
            _emergency_retreat(probe)
            raise
    robot.move_joint(motion.q_home, TRANSFER_SPEED, TRANSFER_ACCELERATION)
    return probe.log


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], None]]:
    """Hold Ctrl-C back inside the block until the yielded check is called, so that it never falls into a command.

    Off the main thread, where no signal arrives, the check does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    pending = False

    def note(*_: object) -> None:
        nonlocal pending
        pending = True

    def check() -> None:
        nonlocal pending
        if pending:
            pending = False
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, note)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()


def _approach(probe: _Probe) -> None:
    """Move along the normal of the first point until the force says that the skin is there."""
    while probe.memory.force < probe.config.contact_force:
        if probe.memory.depth > probe.config.search_depth:
            raise RobotError(
                f"no contact within {probe.config.search_depth * 1e3:.0f} mm beyond the planned skin: is the phantom "
                "where the cameras saw it, and is the sensor connected?",
                probe.memory.depth,
            )
        probe.advance("approach", probe.config.approach_speed)


def _settle(probe: _Probe) -> None:
    """Raise the force to its set-point on the first point of the path; its last periods already send the path."""
    period = probe.robot.period
    count = round(probe.config.settle_time / period)
    for k in range(count):
        probe.index = max(probe.lead - (count - k), 0)
        probe.regulate("settle", contact.ramped_set_point(k * period, probe.config))


def _follow_path(probe: _Probe, progress: Callable[[float], None]) -> None:
    """Move along the path while the force is held; once the path's end is sent, the arm is awaited there."""
    count = len(probe.motion.q)
    for index in range(count):
        probe.index = min(index + probe.lead, count - 1)
        probe.regulate("loop", probe.config.force, reached=index)
        if index % PROGRESS_EVERY == 0:
            progress(index / count)
    progress(1.0)


def _retreat(probe: _Probe) -> None:
    """Leave the skin along the probe axis and come to rest."""
    while probe.memory.depth > -probe.motion.clearance:
        probe.advance("retreat", -probe.config.retreat_speed)
    while probe.memory.rate < 0.0:
        probe.advance("retreat", 0.0)


def _emergency_retreat(probe: _Probe) -> None:
    """Leave the skin, faster, then stop; limits that speak up on the way do not end the retreat."""
    speed = EMERGENCY_FACTOR * probe.config.retreat_speed
    distance = probe.memory.depth + probe.motion.clearance
    longest = distance / speed + 2.0 * speed / probe.config.acceleration
    for _ in range(round(longest / probe.robot.period)):
        with suppress(SafetyError):
            probe.advance("emergency retreat", -speed if probe.memory.depth > -probe.motion.clearance else 0.0)
    probe.robot.stop()
