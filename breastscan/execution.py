"""Execution: the phases of a scan on a robot, under force control and supervision [Zhang, Sec.
V-B.2, Fig. 23].

Every period the planned probe pose is shifted along its own axis by the depth that the force
controller asks for (`control.contact`), and across it as breath and drag move the skin there
(`control.across`); one Newton step of the inverse kinematics turns the shifted pose into joint
targets, which the supervisor limits (`control.safety`). The arm follows its
targets late by a known time, so the plan is sent ahead by as much: the arm then is where the plan
is. Whatever goes wrong ends in a retreat up the normal.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan import approach
from breastscan.control import across, contact, monitor, phases, safety, selection, tilt
from breastscan.control.across import AcrossMemory, Pressed
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.lag import LagEstimate
from breastscan.control.monitor import MonitorMemory, Observation
from breastscan.control.phases import (
    PRESSING,
    PathSection,
    Phase,
    PhaseCommand,
    Progress,
    Situation,
)
from breastscan.control.safety import JointCommand, SafetyLimits, Sent, Workspace
from breastscan.control.tilt import Drag, TiltMemory
from breastscan.errors import PlanningError, RobotError
from breastscan.geometry import se3
from breastscan.interruptions import deferred_interrupt, no_garbage_collection
from breastscan.planning.motion import Motion
from breastscan.robot.interface import Robot
from breastscan.robot.standing import StandingRobot
from breastscan.run.trajectory import NOWHERE, RESUME, Sample

PROGRESS_EVERY = 250
"""Control periods between two reports of progress."""
REFUSALS = 25
"""Refused commands in a row after which a retreat is given up: the robot does not take commands
again."""


def execute(
    robot: Robot,
    motion: Motion,
    config: ContactConfig,
    limits: SafetyLimits,
    *,
    log: list[Sample] | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    pause: Callable[[], bool] = lambda: False,
    start: int = 0,
    in_air: bool = False,
    q_home: Float[np.ndarray, "6"] | None = None,
) -> list[Sample]:
    """Run the whole contact scan on a robot, always leave the skin, and park.

    Args:
        robot: The twin or the real arm.
        motion: What the planner made.
        config: Force control.
        limits: What ends the scan.
        log: Where every control period in contact or close to it goes, also those of a scan that
            ends early. One that was cut off before is gone on with.
        progress: Called with the fraction of the path that is done, 0 to 1.
        pause: Called every period: whether to wait, clear of the skin; the scan then goes on where
            it was.
        start: Row of the plan at which contact is made: `scan_log.resumption_row` of a scan that
            was cut off. The arm may still stand in contact, or above where it was.
        in_air: Whether to travel the path at its clearance, without contact.
        q_home: Where the arm parks in the end [rad]; None for where it stands now, or clear of the
            skin above it.

    Returns:
        The log.

    Raises:
        PlanningError: The plan has no row to start at.
        SafetyError: A limit was passed; the probe was retreated first.
        RobotError: No contact was found, or the robot refused.
        KeyboardInterrupt: The user ended it; the probe was retreated first.
    """
    if not 0 <= start < len(motion.q):
        raise PlanningError(f"a plan of {len(motion.q)} rows has no row {start} to start at", start)
    log = [] if log is None else log
    if log:
        log.append(_resumption(robot, start))

    def follow(section: PathSection, first_row: int, told: Callable[[float], None]) -> None:
        """A part of a stroke, from clear of the skin above one of its rows."""
        robot.tare()
        _Cycle(StandingRobot(robot), motion, section, config, limits, [], first_row).rehearse()
        cycle = _Cycle(robot, motion, section, config, limits, log, first_row)
        with deferred_interrupt() as check_interrupt, no_garbage_collection():
            cycle.run(check_interrupt, pause, told)
        if cycle.error is not None:
            robot.stop()
            raise cycle.error

    place = approach.place(robot, motion)
    if q_home is not None:
        q_park = q_home
    else:
        q_park = place.q_lifted if place is not None and place.touching else robot.state().q
    for stroke in range(motion.stroke_of(start), len(motion.starts)):
        first = max(start, motion.starts[stroke])
        if place is None:
            approach.follow_way(robot, motion, stroke)
        above = approach.go_above(robot, motion, place, first)
        if above < first:
            to_start = PathSection(first, first, in_air=True, clearance=motion.clearance)
            follow(to_start, above, lambda fraction: None)
        section = PathSection(motion.lasts[stroke], first, in_air, motion.clearance)
        follow(section, first, progress)
        place = None
    approach.follow_way(robot, motion, len(motion.starts))
    approach.transfer(robot, q_park)
    return log


def _resumption(robot: Robot, start: int) -> Sample:
    """Where a scan that was cut off goes on, before the arm moves."""
    state = robot.state()
    return Sample(
        state.time, RESUME, float(start), state.q, state.qd, state.q, state.wrench_P, False
    )


@dataclass(frozen=True)
class _Selected:
    """The pose of the probe for this period, and the joint target that takes it there."""

    X_BP_reference: Float[np.ndarray, "4 4"]
    """As planned, and moved across the probe axis."""
    X_BP: Float[np.ndarray, "4 4"]
    """As corrected by force and tilt."""
    command: JointCommand


class _Cycle:
    """The control cycle, and what it carries from one period to the next."""

    def __init__(
        self,
        robot: Robot,
        motion: Motion,
        section: PathSection,
        config: ContactConfig,
        limits: SafetyLimits,
        log: list[Sample],
        first_row: int,
    ) -> None:
        self.robot = robot
        self.motion = motion
        self.section = section
        self.config = config
        self.limits = limits
        self.log = log
        self.error: BaseException | None = None
        """Why the scan ends early."""
        self._progress = Progress(Phase.TRAVEL, row=float(first_row))
        self._memory = ContactMemory.resting(-motion.clearance, robot.servo, robot.period)
        self._state = robot.state()
        self._sent = Sent.resting(self._state.q)
        self._monitor = MonitorMemory.beginning(self._observation())
        self._refused = 0
        """Commands in a row."""
        self._began = False
        """Whether a command was taken."""
        self._overspeed_time = 0.0
        self._lag = LagEstimate.resting(self._state.q, robot.servo.lag, robot.period)
        self._tilt = TiltMemory()
        self._across = AcrossMemory()
        self._X_PF = se3.inverse(robot.X_FP)
        X_BP = robot.calibration.forward(motion.at(float(first_row))) @ robot.X_FP
        self._reference_B = X_BP[:3, 3]
        self._axis_B = X_BP[:3, 2]
        self._R_BP = X_BP[:3, :3]
        self._velocity_B = np.zeros(3)
        """Of the reference [m/s]."""
        tips_B = (robot.calibration.forward(motion.q) @ robot.X_FP)[:, :3, 3]
        self._workspace = Workspace.around(tips_B, motion.clearance + limits.workspace_margin)

    def run(
        self,
        check_interrupt: Callable[[], None],
        pause: Callable[[], bool],
        progress: Callable[[float], None],
    ) -> None:
        """Every phase, to the end; `error` then says whether it was the good one."""
        periods = 0
        self._resync()
        while self._progress.phase is not Phase.DONE and self._refused <= REFUSALS:
            try:
                check_interrupt()
                if periods % PROGRESS_EVERY == 0:
                    progress(self._progress.row / (len(self.motion.q) - 1))
                self.cycle(pause())
            except (Exception, KeyboardInterrupt) as error:
                # something keeps the retreat itself from running
                self._refused += self._progress.phase is Phase.ESCAPE
                self._end(error)
            periods += 1
        if self._refused > REFUSALS:
            why = (
                f"{self.error}; the robot takes no commands, so the probe was not retreated: "
                "move it away by hand"
            )
            self.error = RobotError(why, self.error)

    def rehearse(self) -> None:
        """Two periods that load every kernel: a tenth of a second, in which a moving arm would
        miss its commands.
        """
        for _ in range(2):
            self.cycle(False)

    def cycle(self, pause: bool) -> None:
        """One period [Zhang, Fig. 23]: the steps of the table in docs/control.md, in order."""
        self.check()
        self.sense()
        self.supervise()
        progress, command = self.decide(pause)
        if progress.phase is Phase.DONE:
            self._progress = progress
            return
        memory = self.regulate(progress, command)
        selected = self.select(progress, memory)
        self.send(progress, memory, selected)

    def check(self) -> None:
        """Is the measurement plausible, and inside the limits?"""
        if self._escaping:
            return
        fault, self._monitor = monitor.check(self._observation(), self._monitor, self.limits)
        if fault is not None:
            self._end(fault)

    def sense(self) -> None:
        """Take the measurement in: the force, and what follows from it of skin, breath and tilt."""
        period = self.robot.period
        if not self._escaping:
            force = -float(self._state.wrench_P[2])
            self._memory = contact.sense(self._memory, force, self.config, period)
        self._across = across.update(self._pressed(), self._across)
        if self._progress.phase in PRESSING:
            drag = Drag(self._wrench(), self._sliding(), self._memory.noise, period)
            self._tilt = tilt.update(drag, self._tilt, self.config.tilt)
        else:
            self._tilt = tilt.rest(self._tilt, self.config.tilt, period)

    def _pressed(self) -> Pressed:
        """What this period says about the skin."""
        memory, chest_B = self._memory, self.motion.chest_normal_B
        return Pressed(
            self._progress.phase,
            memory.servo.position,
            memory.last,
            memory.surface,
            0.0 if chest_B is None else float(chest_B @ self._axis_B),
            self._lag.lag,
            self.robot.period,
        )

    def _wrench(self) -> tuple[float, float, float, float]:
        """Forces, and the moment about y, at the tip in P [N, N m]."""
        fx, fy, fz, _, my, _ = self._state.wrench_P.tolist()
        return fx, fy, fz, my

    def _sliding(self) -> tuple[float, float]:
        """Velocity of the tip across the skin, which moves with the chest, in x and y of P
        [m/s].
        """
        velocity_B = self._velocity_B
        if self.motion.chest_normal_B is not None:
            velocity_B = velocity_B - self._across.skin_rate * self.motion.chest_normal_B
        vx, vy, _ = (velocity_B @ self._R_BP).tolist()
        return vx, vy

    def supervise(self) -> None:
        """Is the skin where it was planned, and does it hold still?"""
        surface = self._memory.surface
        if surface is None or self._progress.phase is not Phase.LOOP:
            return
        self._overspeed_time = safety.overspeed_time(
            surface.speed, self._overspeed_time, self.limits, self.robot.period
        )
        fault = safety.check_skin(
            surface.position, surface.speed, self._overspeed_time, self.limits
        )
        if fault is not None:
            self._end(fault)

    def decide(self, pause: bool) -> tuple[Progress, PhaseCommand]:
        """Which phase is this, and what does it command?"""
        memory = self._memory
        touching = contact.touches(memory, self.config)
        now = Situation(memory.depth, memory.rate, memory.slow.force, touching, pause)
        progress, command = self._step(now)
        if command.fault is not None:
            self._end(command.fault)
            progress, command = self._step(now)
        return progress, command

    def regulate(self, progress: Progress, command: PhaseCommand) -> ContactMemory:
        """How deep the tip is to be along the probe axis: by the force law, or at a speed."""
        memory = self._memory
        if command.contact_made:
            memory = contact.begin(memory, self.config)
        if command.contact_lost:
            memory = contact.end(memory)
        lag, period = self._lag.lag, self.robot.period
        if command.reference is not None:
            return contact.regulate(memory, command.reference, self.config, lag, period)
        escaping = progress.phase is Phase.ESCAPE
        acceleration = (
            self.config.phases.escape_acceleration if escaping else self.config.acceleration
        )
        return contact.advance(memory, command.speed, acceleration, lag, period)

    def select(self, progress: Progress, memory: ContactMemory) -> _Selected:
        """S of the plan, which is sent ahead by the servo's lag, and S' of the force."""
        rows_ahead = progress.feed_override * self._lag.lag / self.robot.period
        ahead = min(progress.row + rows_ahead, float(self.section.last))
        arm = self.robot.calibration
        X_BP_plan = arm.forward(self.motion.at(ahead)) @ self.robot.X_FP
        X_BP_reference = selection.moved_across(X_BP_plan, self._shift(ahead, 0.0))
        X_BP = selection.corrected(X_BP_reference, memory.depth, self._tilt.rx, self._tilt.ry)
        q = arm.step(self._sent.q, X_BP @ self._X_PF)
        return _Selected(X_BP_reference, X_BP, JointCommand(q, X_BP[:3, 3], memory.depth))

    def _shift(self, row: float, lag: float) -> Float[np.ndarray, "3"]:
        """How far drag and breath have moved the skin, as the servo has it after a lag [s], in B
        [m].
        """
        shift_B = self.motion.drag_at(row, self._across.indentation)
        if self.motion.chest_normal_B is not None:
            shift_B = shift_B + self._across.rise_before(lag) * self.motion.chest_normal_B
        return shift_B

    def send(self, progress: Progress, memory: ContactMemory, selected: _Selected) -> None:
        """The command within the limits, to the robot; what was decided counts once it is taken."""
        sent = safety.limit_command(
            selected.command, self._sent, self._workspace, self.limits, self.robot.period
        )
        if sent.fault is not None:
            self._end(sent.fault)
        try:
            self.robot.servo_joint(sent.q)
        except RobotError as error:
            self._refuse(error)
            return
        if not self._began:  # with what was known before it, so that a log can be played back
            self._note(progress, self._sent.q, touching=False)
            self._began = True
        self._memory = memory
        self._sent = sent
        self._refused = 0
        self._progress = progress if self.error is None else phases.escape(progress, self._felt)
        self._state = self.robot.state()
        self._lag = self._lag.after(sent.q, self._state.q, self.robot.period)
        reference_B = selected.X_BP_reference[:3, 3]
        self._velocity_B = (reference_B - self._reference_B) / self.robot.period
        self._reference_B = reference_B
        self._axis_B = selected.X_BP_reference[:3, 2]
        self._R_BP = selected.X_BP[:3, :3]
        self._note(progress, sent.q, touching=contact.touches(memory, self.config))

    def _step(self, now: Situation) -> tuple[Progress, PhaseCommand]:
        """The state machine's, from where the scan stands."""
        return phases.step(
            self._progress,
            now,
            self.section,
            self.config.force,
            self.config.phases,
            self.robot.period,
        )

    def _resync(self) -> None:
        """Begin with the present state: on a robot whose clock runs by itself, the preparations
        have taken time.
        """
        self._state = self.robot.state()
        self._monitor = MonitorMemory.beginning(self._observation())

    def _note(self, progress: Progress, target: Float[np.ndarray, "6"], *, touching: bool) -> None:
        """Log the state that followed `target`, when the arm should be at the progress's row of
        the plan.
        """
        state, row = self._state, math.nan
        shift_B = NOWHERE
        if progress.phase is Phase.LOOP:
            row, shift_B = progress.row, self._shift(progress.row, self._lag.lag)
        sample = Sample(
            state.time, progress.phase, row, state.q, state.qd, target, state.wrench_P, touching,
            shift_B,
        )  # fmt: skip
        self.log.append(sample)

    def _end(self, error: BaseException) -> None:
        """Begin the retreat; the first error is the one that is told."""
        if self.error is None:
            self.error = error
        self._progress = phases.escape(self._progress, self._felt)

    def _refuse(self, error: RobotError) -> None:
        """Stop, and begin the retreat from wherever the robot then is, should it take commands
        again.
        """
        self._refused += 1
        self._end(error)
        with suppress(RobotError):
            self.robot.stop()
            self._state = self.robot.state()
            self._sent = Sent.resting(self._state.q)

    @property
    def _escaping(self) -> bool:
        """Whether the probe retreats whatever is measured."""
        return self._progress.phase is Phase.ESCAPE

    @property
    def _felt(self) -> float:
        """Depth at which the skin is felt [m], 0 in the air."""
        return 0.0 if self._memory.surface is None else self._memory.depth

    def _observation(self) -> Observation:
        state = self._state
        return Observation(
            state.time,
            state.sample,
            tuple(state.wrench_P.tolist()),
            self.config.force,
            self._memory.depth,
            self.robot.period,
        )
