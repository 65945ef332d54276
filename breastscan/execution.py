"""Execution: the phases of a scan on a robot, under force control and supervision [Zhang, Sec.
V-B.2, Fig. 23].

Every period the planned probe pose is shifted along its own axis by the depth that the force
controller asks for (`control.contact`), and one Newton step of the inverse kinematics turns the
shifted pose into joint targets, which the supervisor lets through (`control.safety`). The arm
follows its targets late by a known time, so the plan is sent ahead by as much: the arm then is
where the plan is. Whatever goes wrong ends in a retreat up the normal.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
from jaxtyping import Float

from breastscan.control import contact, phases, safety, selection, tilt, watch
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.lag import LagEstimate
from breastscan.control.phases import PRESSING, Phase, Progress, Route, Situation
from breastscan.control.safety import Command, SafetyLimits, Sent, Workspace
from breastscan.control.tilt import Drag, TiltMemory
from breastscan.control.watch import Observation, Watch
from breastscan.errors import PlanningError, RobotError
from breastscan.geometry import se3
from breastscan.interruptions import deferred_interrupt, no_garbage_collection
from breastscan.planning.motion import Motion
from breastscan.robot.interface import Robot
from breastscan.run.trajectory import Sample, Trajectory

TRANSFER_SPEED = 0.6
"""Top joint speed of the free motions to and from the breast [rad/s]."""
TRANSFER_ACCELERATION = 0.8
"""Joint acceleration of the free motions [rad/s^2]."""
PROGRESS_EVERY = 250
"""Control periods between two reports of progress."""
REFUSALS = 25
"""Refused commands in a row after which a retreat is given up: the robot does not take commands
again."""
NEAR = 0.05
"""Joint distance within which a robot still stands where an earlier scan left it [rad]."""


def execute(
    robot: Robot,
    motion: Motion,
    config: ContactConfig,
    limits: SafetyLimits,
    *,
    log: list[Sample] | None = None,
    progress: Callable[[float], None] = lambda share: None,
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
            ends early.
        progress: Told the share of the path that is done, 0 to 1.
        pause: Asked every period whether to wait, clear of the skin; the scan then goes on where it
            was.
        start: Row of the plan at which contact is made: `last_row` of a scan that was cut off.
        in_air: Whether to travel the path at its clearance, without contact.
        q_home: Where the arm parks in the end [rad]; None for where it stands now.

    Returns:
        The log.

    Raises:
        PlanningError: The plan has no row to start at.
        SafetyError: A limit was passed; the probe was retreated first.
        RobotError: No contact was found, or the robot refused.
        KeyboardInterrupt: The user asked for an end; the probe was retreated first.
    """
    if not 0 <= start < len(motion.q):
        raise PlanningError(f"a plan of {len(motion.q)} rows has no row {start} to start at", start)
    log = [] if log is None else log
    q_start = robot.state().q
    lifted = motion.lifted(start, robot.X_FP, robot.calibration)
    stands_there = float(np.abs(q_start - lifted).max()) < NEAR
    robot.move_joint(
        lifted if stands_there else motion.q_approach, TRANSFER_SPEED, TRANSFER_ACCELERATION
    )
    robot.tare()
    route = Route(len(motion.q) - 1, start, in_air, motion.clearance)
    first_row = start if stands_there else 0
    _Probe(_standing(robot), motion, route, config, limits, [], first_row=first_row).rehearse()
    probe = _Probe(robot, motion, route, config, limits, log, first_row=first_row)
    with deferred_interrupt() as check_interrupt, no_garbage_collection():
        probe.run(check_interrupt, pause, progress)
    if probe.error is not None:
        robot.stop()
        raise probe.error
    robot.move_joint(q_start if q_home is None else q_home, TRANSFER_SPEED, TRANSFER_ACCELERATION)
    return log


def _standing(robot: Robot) -> Robot:
    """The robot as it stands, whom nobody moves."""
    state, period = robot.state(), robot.period

    def servo_joint(q: Float[np.ndarray, "6"]) -> None:
        nonlocal state
        state = replace(state, time=state.time + period, sample=state.sample + 1)

    told = {name: getattr(robot, name) for name in ("period", "X_FP", "calibration", "servo_lag")}
    told |= dict.fromkeys(("move_joint", "tare", "stop"), lambda *_: None)
    return cast(Robot, SimpleNamespace(**told, state=lambda: state, servo_joint=servo_joint))


class _Probe:
    """The probe on its way: senses, decides, sends, and remembers where it is."""

    def __init__(
        self,
        robot: Robot,
        motion: Motion,
        route: Route,
        config: ContactConfig,
        limits: SafetyLimits,
        log: list[Sample],
        *,
        first_row: int,
    ) -> None:
        self.robot = robot
        self.motion = motion
        self.route = route
        self.config = config
        self.limits = limits
        self.log = log
        self.error: BaseException | None = None
        """Why the scan ends early."""
        self._progress = Progress(Phase.TRAVEL, row=float(first_row))
        self._memory = ContactMemory.resting(-motion.clearance, robot.period)
        self._state = robot.state()
        self._sent = Sent.resting(self._state.q)
        self._watch = Watch.beginning(self._observation())
        self._refused = 0
        self._began = False
        """Whether a command was taken."""
        self._hurry = 0.0
        self._lag = LagEstimate.resting(self._state.q, robot.servo_lag, robot.period)
        self._tilt = TiltMemory()
        self._X_PF = se3.inverse(robot.X_FP)
        X_BP = robot.calibration.forward(motion.at(float(first_row))) @ robot.X_FP
        self._planned_B = X_BP[:3, 3]
        self._R_BP = X_BP[:3, :3]
        self._velocity_B = np.zeros(3)
        tips_B = (robot.calibration.forward(motion.q) @ robot.X_FP)[:, :3, 3]
        self._workspace = Workspace.around(tips_B, motion.clearance + limits.workspace_margin)

    def run(
        self,
        check_interrupt: Callable[[], None],
        pause: Callable[[], bool],
        progress: Callable[[float], None],
    ) -> None:
        """Every phase, to the end; `error` then says whether it was the good one."""
        cycle = 0
        self._look_anew()
        while self._progress.phase is not Phase.DONE and self._refused <= REFUSALS:
            try:
                check_interrupt()
                if cycle % PROGRESS_EVERY == 0:
                    progress(self._progress.row / self.route.last)
                self._cycle(pause())
            except (Exception, KeyboardInterrupt) as error:
                # something keeps the retreat itself from running
                self._refused += self._progress.phase is Phase.ESCAPE
                self._end(error)
            cycle += 1
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
            self._cycle(False)

    def _look_anew(self) -> None:
        """Begin with the state of now: on a robot whose clock runs by itself, the preparations
        have taken time.
        """
        self._state = self.robot.state()
        self._watch = Watch.beginning(self._observation())

    def _cycle(self, pause: bool) -> None:
        """One control period."""
        if self._progress.phase is not Phase.ESCAPE:
            self._sense()
        memory, progress, demand = self._decide(pause)
        if progress.phase is Phase.DONE:
            self._progress = progress
            return
        if demand.meets:
            memory = contact.meet(memory, self.config)
        if demand.leaves:
            memory = contact.leave(memory)
        lag, period = self._lag.lag, self.robot.period
        if demand.reference is not None:
            memory = contact.regulate(memory, demand.reference, self.config, lag, period)
        else:
            escaping = progress.phase is Phase.ESCAPE
            acceleration = (
                self.config.phases.escape_acceleration if escaping else self.config.acceleration
            )
            memory = contact.advance(memory, demand.speed, acceleration, lag, period)
        self._send(memory, progress)

    def _sense(self) -> None:
        """Take the latest state in, unless there is something wrong with it."""
        fault, self._watch = watch.look(self._observation(), self._watch, self.limits)
        if fault is not None:
            self._end(fault)
            return
        self._memory = contact.sense(
            self._memory, -float(self._state.wrench_P[2]), self.config, self.robot.period
        )
        if self._progress.phase in PRESSING:
            fx, fy, fz, _, my, _ = self._state.wrench_P.tolist()
            vx, vy, _ = (self._velocity_B @ self._R_BP).tolist()
            drag = Drag((fx, fy, fz, my), (vx, vy), self._memory.noise, self.robot.period)
            self._tilt = tilt.turn(drag, self._tilt, self.config.tilt)
        surface = self._memory.surface
        if surface is not None and self._progress.phase is Phase.LOOP:
            self._hurry = safety.hurried(surface.speed, self._hurry, self.limits, self.robot.period)
            fault = safety.judge_skin(surface.position, surface.speed, self._hurry, self.limits)
            if fault is not None:
                self._end(fault)

    def _decide(self, pause: bool) -> tuple[ContactMemory, Progress, phases.Demand]:
        """What to do in this period."""
        memory, settings = self._memory, self.config.phases
        now = Situation(
            memory.depth,
            memory.rate,
            memory.slow.force,
            contact.touches(memory, self.config),
            pause,
        )
        progress, demand = phases.step(
            self._progress, now, self.route, self.config.force, settings, self.robot.period
        )
        if demand.fault is not None:
            self._end(demand.fault)
            progress, demand = phases.step(
                self._progress, now, self.route, self.config.force, settings, self.robot.period
            )
        return memory, progress, demand

    def _send(self, memory: ContactMemory, progress: Progress) -> None:
        """One command to the robot; what was decided counts once it is taken."""
        ahead = min(
            progress.row + progress.feed * self._lag.lag / self.robot.period, float(self.route.last)
        )
        arm = self.robot.calibration
        X_BP_plan = arm.forward(self.motion.at(ahead)) @ self.robot.X_FP
        X_BP = selection.corrected(X_BP_plan, memory.depth, self._tilt.rx, self._tilt.ry)
        command = Command(arm.step(self._sent.q, X_BP @ self._X_PF), X_BP[:3, 3], memory.depth)
        sent = safety.let_through(
            command, self._sent, self._workspace, self.limits, self.robot.period
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
        self._velocity_B = (X_BP_plan[:3, 3] - self._planned_B) / self.robot.period
        self._planned_B, self._R_BP = X_BP_plan[:3, 3], X_BP[:3, :3]
        self._note(progress, sent.q, touching=contact.touches(memory, self.config))

    def _note(self, progress: Progress, target: Float[np.ndarray, "6"], *, touching: bool) -> None:
        """Log the state that followed `target`, when the arm should be at the progress's row of
        the plan.
        """
        state, row = self._state, progress.row if progress.phase is Phase.LOOP else math.nan
        sample = Sample(
            state.time, progress.phase, row, state.q, state.qd, target, state.wrench_P, touching
        )
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


def trajectory(log: list[Sample], motion: Motion, robot: Robot) -> Trajectory:
    """The whole log, the planned values beside the measured ones; off the path these are NaN.

    The poses are by the arm's kinematics as the robot reports them, and no truer than these.
    """
    row = np.array([sample.row for sample in log])
    first = np.nan_to_num(row).astype(int)
    second = np.minimum(first + 1, len(motion.q) - 1)
    q = np.stack([sample.q for sample in log])

    def planned(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        between = flat[first] + (row - first)[:, None] * (flat[second] - flat[first])
        return between.reshape(len(log), *values.shape[1:])

    return Trajectory(
        t=np.array([sample.time for sample in log]),
        phase=tuple(str(sample.phase) for sample in log),
        s=planned(motion.s),
        q=q,
        qd=np.stack([sample.qd for sample in log]),
        target=np.stack([sample.target for sample in log]),
        q_plan=planned(motion.q),
        qd_plan=planned(motion.qd),
        X_BP=robot.calibration.forward(q) @ robot.X_FP,
        X_BP_plan=planned(robot.calibration.forward(motion.q) @ robot.X_FP),
        wrench_P=np.stack([sample.wrench_P for sample in log]),
        contact=np.array([sample.contact for sample in log]),
    )


def last_row(log: list[Sample]) -> int:
    """The last row of the plan that was reached in contact; a scan that was cut off starts again
    there.
    """
    return next((int(sample.row) for sample in reversed(log) if not math.isnan(sample.row)), 0)
