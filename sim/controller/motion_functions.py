"""The functions that take time: those that move the arm, each until the controller has done it,
and those that wait.
"""

from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from functools import wraps
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.robot.ur.targets import SPEED_TOLERANCE
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD, SPEED_LIMIT
from sim.arm.servo import GAIN_RANGE, LOOKAHEAD_RANGE
from sim.controller import motion
from sim.controller.controller import Controller
from sim.controller.curves import Circle, Pace
from sim.controller.force_functions import direct_torque
from sim.controller.kinematics import inverse
from sim.controller.messages import Text
from sim.controller.motion import Braking, JointSpeed, Servo, ToolSpeed, Travel
from sim.controller.states import Cause
from sim.controller.urscript.signature import (
    JOINTS,
    NUMBER,
    PLACE,
    POSITIVE,
    REFUSED,
    Function,
    Kind,
    Parameter,
    row,
    whole,
)
from sim.controller.urscript.values import Pose, ScriptError, is_number

Wait = Generator[None, None, None]
Vector6 = Float[np.ndarray, "6"]
Line = Callable[[Vector6, Pace], Travel]
"""(joint angles at its beginning [rad], pace) -> the motion along it."""
FRACTION = Kind(
    "a number above 0, at most 1",
    lambda value: float(value) if is_number(value) and 0 < value <= 1 else REFUSED,
)
LATE_TIME = 0.1
"""A servo target that the joints could not reach in so long counts as a jump [s]: a client may miss
some periods."""
REACHED, TOOL_REACHED = 1e-6, 2e-3
"""Difference from a speed of the joints and of the tool at which it is reached [rad/s; m/s, rad/s]:
the tool's changes a little in a period in which the joints' stays."""
OPTIMOVE_ACCELERATION = 14.0
"""Of the leading joint, where a program asks for all of it [rad/s^2]: assumed."""
SLOWEST_STOP = 0.1
"""Deceleration of the leading joint that a stop has at least [rad/s^2]."""
ROUNDING = 1e-9
"""[s]"""
LONGEST_SLEEP = 1e6
"""[s]"""


def motion_functions(controller: Controller) -> Iterable[Function]:
    """Their rows; accelerations, speeds and times in rad, m and s, with the manual's defaults."""
    moves = _Moves(controller)
    joint_a, joint_v = Parameter("a", NUMBER, 1.4), Parameter("v", NUMBER, 1.05)
    tool_a, tool_v = Parameter("a", NUMBER, 1.2), Parameter("v", NUMBER, 0.25)
    share_a, share_v = Parameter("a", FRACTION, 0.3), Parameter("v", FRACTION, 0.3)
    t, r = Parameter("t", NUMBER, 0.0), Parameter("r", NUMBER, 0.0)
    until, rotation_a = Parameter("t", NUMBER, None), Parameter("aRot", POSITIVE, None)
    place, goal = Parameter("pose", PLACE), Parameter("goal", PLACE)
    via, to = Parameter("pose_via", PLACE), Parameter("pose_to", PLACE)
    mode = Parameter("mode", whole(0, 1), 0)
    qd, xd = Parameter("qd", JOINTS), Parameter("xd", JOINTS)
    speed_a, line_a = Parameter("a", POSITIVE, 1.4), Parameter("a", POSITIVE, 1.2)
    following = (
        Parameter("q", JOINTS), Parameter("a", NUMBER, 0.0), Parameter("v", NUMBER, 0.0),
        Parameter("t", NUMBER, PERIOD), Parameter("lookahead_time", NUMBER, 0.1),
        Parameter("gain", NUMBER, 300.0),
    )  # fmt: skip
    rows = (
        row("movej", moves.movej, Parameter("q", PLACE), joint_a, joint_v, t, r),
        row("movel", moves.movel, place, tool_a, tool_v, t, r),
        row("movep", moves.movep, place, tool_a, tool_v, r),
        row("servoc", moves.movep, place, tool_a, tool_v, r),
        row("movec", moves.movec, via, to, tool_a, tool_v, r, mode),
        row("optimovej", moves.optimovej, goal, share_a, share_v, r),
        row("optimovel", moves.optimovel, goal, share_a, share_v, r),
        row("servoj", moves.servoj, *following),
        row("speedj", moves.speedj, qd, speed_a, until),
        row("speedl", moves.speedl, xd, line_a, until, rotation_a),
        row("stopj", moves.stopj, Parameter("a", NUMBER, 2.0)),
        row("stopl", moves.stopl, Parameter("a", NUMBER, 1.2), rotation_a),
        *direct_torque(controller),
    )
    yield from (row(r.name, _owned(controller, r.call), *r.parameters, waits=True) for r in rows)
    yield row("get_target_waypoint", moves.waypoint, costly=True)
    yield row("sync", _sync, waits=True)
    yield row("sleep", sleep, Parameter("t", NUMBER), waits=True)


def _sync() -> Wait:
    """Wait for the next period."""
    yield


def sleep(seconds: float) -> Wait:
    """Wait so long, for a period at least."""
    for _ in range(round(min(max(seconds, PERIOD), LONGEST_SLEEP) / PERIOD)):
        yield


def _owned(controller: Controller, move: Callable[..., Wait]) -> Callable[..., Wait]:
    """One thread moves the arm at a time."""

    @wraps(move)
    def run(*arguments: Any) -> Wait:
        assert controller.program is not None, "only programs move the arm"
        me = controller.program.current
        if controller.owner not in (None, me) and controller.owner.alive:
            raise ScriptError("another thread is already controlling the robot")
        controller.owner = me
        try:
            yield from move(*arguments)
        finally:
            if controller.owner is me:
                controller.owner = None

    return run


class _Moves:
    """What the functions do."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._robot = controller, controller.robot
        self._ahead = 0.0
        """By which the last speed lasted too long, in whole periods: the next one makes up for it
        [s]."""

    def movej(self, x: Pose | Vector6, a: float, v: float, t: float, r: float) -> Wait:
        """Straight in joint space."""
        q = inverse(self._controller, x, self._start) if isinstance(x, Pose) else x
        yield from self._travel(self._joint_line(q), _pace(a, v, t), r)

    def movel(self, x: Pose | Vector6, a: float, v: float, t: float, r: float) -> Wait:
        """Straight in space, as far as the arm goes: a program that moves until the tool meets
        something asks for a kilometre.
        """
        yield from self._travel(self._straight_line(x), _pace(a, v, t), r)

    def movep(self, x: Pose | Vector6, a: float, v: float, r: float) -> Wait:
        """The same, at one speed of the tool also through the corners."""
        yield from self._travel(self._straight_line(x), _pace(a, v, 0.0), r, steady=True)

    def movec(
        self, via: Pose | Vector6, to: Pose | Vector6, a: float, v: float, r: float, mode: int
    ) -> Wait:
        """Along a circle."""
        X_via, X_to = self._tool_pose(via), self._tool_pose(to)
        X_FT, arm = self._controller.X_FT, self._robot.calibration

        def line(start: Vector6, pace: Pace) -> Travel:
            p_B = (arm.forward(start) @ X_FT)[:3, 3]
            circle = Circle.through(p_B, X_via[:3, 3], X_to[:3, 3])
            if circle is None:
                raise ScriptError("movec: the three points lie on a line, no circle passes them")
            return motion.circular_travel(
                arm, start, circle, X_FT, pace, X_to if mode == 0 else None
            )

        yield from self._travel(line, _pace(a, v, 0.0), r)

    def optimovej(self, x: Pose | Vector6, a: float, v: float, r: float) -> Wait:
        """A movej at shares of what the joints can do; without the limits of jerk."""
        q = inverse(self._controller, x, self._start) if isinstance(x, Pose) else x
        pace = Pace(v * SPEED_LIMIT, a * OPTIMOVE_ACCELERATION)
        yield from self._travel(self._joint_line(q), pace, r)

    def optimovel(self, x: Pose | Vector6, a: float, v: float, r: float) -> Wait:
        """A movel, likewise; the joint that moves most along the line says how fast it can be."""
        inverse(self._controller, Pose.of(self._tool_pose(x)))
        line = self._straight_line(x)
        most = line(self._start, Pace(1.0, 1.0)).joint_travel_a_unit()
        pace = Pace(v * SPEED_LIMIT / most, a * OPTIMOVE_ACCELERATION / most)
        yield from self._travel(line, pace, r)

    def waypoint(self) -> Pose:
        """Where the tool goes by the active move, else where it is to be [UR-script]."""
        controller, moving = self._controller, self._controller.motion
        q = moving.end if isinstance(moving, Travel) else self._robot.commanded[0]
        return Pose.of(controller.tool_pose(q))

    def servoj(
        self, q: Vector6, a: float, v: float, t: float, lookahead_time: float, gain: float
    ) -> Wait:
        """Towards a target that the next call replaces."""
        controller, robot = self._controller, self._robot
        last = controller.motion.q if isinstance(controller.motion, Servo) else robot.commanded[0]
        if (
            not np.abs(q).max() <= ANGLE_LIMIT
            or np.abs(q - last).max() > SPEED_TOLERANCE * LATE_TIME * SPEED_LIMIT
        ):
            controller.protective_stop("servoj: the target is too far away", Cause.JUMP)
            yield
            return
        robot.tune_servo(min(max(lookahead_time, LOOKAHEAD_RANGE[0]), LOOKAHEAD_RANGE[1]),
                         min(max(gain, GAIN_RANGE[0]), GAIN_RANGE[1]))  # fmt: skip
        if isinstance(controller.motion, Servo):
            controller.motion.q = q
        else:
            controller.motion = Servo(q)
        yield from sleep(t)

    def speedj(self, qd: Vector6, a: float, t: float | None) -> Wait:
        """At joint speeds; without a time, until they are reached."""
        controller, robot = self._controller, self._robot
        controller.motion = JointSpeed(qd, a)
        if t is not None:
            yield from self._last(t)
            return
        yield
        while np.abs(robot.commanded[1] - controller.scaling * qd).max() > REACHED:
            yield

    def speedl(self, xd: Vector6, a: float, t: float | None, rotation_a: float | None) -> Wait:
        """At a velocity of the tool; without a time, until it is reached."""
        controller = self._controller
        controller.motion = self._tool_speed(xd, a, rotation_a)
        if t is not None:
            yield from self._last(t)
            return
        yield
        while np.abs(self._speed_of_tool() - controller.scaling * xd).max() > TOOL_REACHED:
            yield

    def _last(self, seconds: float) -> Wait:
        """So long at full speed, longer where the motion is slowed down: a client's spline is then
        followed at any speed.
        """
        controller = self._controller
        left = max(min(seconds, LONGEST_SLEEP), PERIOD) + self._ahead
        while left > ROUNDING:
            yield
            left -= PERIOD * controller.scaling * controller.supervision.pace
        self._ahead = left

    def stopj(self, a: float) -> Wait:
        """To rest."""
        controller = self._controller
        mine = controller.motion = Braking(self._robot, max(a, SLOWEST_STOP))
        yield
        while controller.motion is mine:
            yield

    def stopl(self, a: float, rotation_a: float | None) -> Wait:
        """The same along the tool's motion."""
        controller = self._controller
        mine = self._tool_speed(np.zeros(6), max(a, SLOWEST_STOP), rotation_a)
        controller.motion = mine
        yield
        while controller.motion is mine:
            if np.abs(self._robot.commanded[1]).max() < REACHED:
                controller.motion = motion.hold
                return
            yield

    def _tool_speed(self, xd: Vector6, a: float, rotation_a: float | None) -> ToolSpeed:
        arm, rotation_a = self._robot.calibration, a if rotation_a is None else rotation_a
        return ToolSpeed(arm, self._controller.X_FT, xd, a, rotation_a)

    def _speed_of_tool(self) -> Vector6:
        return self._controller.tool_speed(*self._robot.commanded)

    def _tool_pose(self, x: Pose | Vector6) -> Float[np.ndarray, "4 4"]:
        return x.matrix if isinstance(x, Pose) else self._controller.tool_pose(x)

    def _joint_line(self, q: Vector6) -> Line:
        if not np.abs(q).max() <= ANGLE_LIMIT:
            raise ScriptError(f"movej to {q.round(4).tolist()}: beyond the joints' limits", q)
        arm, X_FT = self._robot.calibration, self._controller.X_FT
        return lambda start, pace: motion.joint_travel(arm, start, q, X_FT, pace)

    def _straight_line(self, x: Pose | Vector6) -> Line:
        X_BT, X_FT = self._tool_pose(x), self._controller.X_FT
        arm = self._robot.calibration
        return lambda start, pace: motion.straight_travel(arm, start, X_BT, X_FT, pace)

    @property
    def _taken_over(self) -> Travel | None:
        """The motion that the next one goes on from without a stop."""
        moving = self._controller.motion
        return moving if isinstance(moving, Travel) and moving.is_taken_over else None

    @property
    def _start(self) -> Vector6:
        """Where the next motion begins [rad]."""
        before = self._taken_over
        return self._robot.commanded[0] if before is None else before.end

    def _travel(self, line: Line, pace: Pace, r: float, *, steady: bool = False) -> Wait:
        """Move along a line, until that is done, or until the next motion may take over; after a
        pause again, from wherever the arm is then.
        """
        controller = self._controller

        def plan() -> Travel:
            before = self._taken_over
            travel = line(self._start, pace)
            late = travel.time_scaling
            if late > 1:
                travel = line(self._start, replace(pace, seconds=late * pace.seconds))
            if r > 0 and not travel.blend(r, steady=steady):
                half = f"a blend of {r:g} m ends half-way to the next waypoint"
                controller.messages.append(Text(f"Overlapping Blends: {half}"))
            return travel if before is None else travel.come_from(before)

        mine = controller.motion = plan()
        while True:
            yield
            if controller.motion is motion.hold or (
                controller.motion is mine and mine.is_taken_over
            ):
                return
            if controller.motion is not mine and not isinstance(controller.motion, Braking):
                return
            if controller.motion is not mine:
                mine = controller.motion = plan()


def _pace(a: float, v: float, t: float) -> Pace:
    """As a program asks for it: a time, where there is one, counts alone."""
    if not (t > 0 or (a > 0 and v > 0)):
        raise ScriptError(f"a move needs a positive a and v, or t, got a={a:g}, v={v:g}, t={t:g}")
    return Pace(v, a, max(t, 0.0))
