"""The functions that take time: those that move the arm, each until the controller has done it,
and those that wait.
"""

from collections.abc import Callable, Generator, Iterable
from functools import wraps
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.robot.ur.targets import SPEED_TOLERANCE
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD, SPEED_LIMIT
from sim.arm.servo import GAIN_RANGE, LOOKAHEAD_RANGE
from sim.controller import motion
from sim.controller.controller import Controller
from sim.controller.force_functions import direct_torque
from sim.controller.kinematics import inverse
from sim.controller.motion import Braking, JointSpeed, Motion, Servo, ToolSpeed
from sim.controller.states import Cause
from sim.controller.urscript.signature import (
    JOINTS,
    NUMBER,
    PLACE,
    POSITIVE,
    Function,
    Parameter,
    row,
)
from sim.controller.urscript.values import Pose, ScriptError

Wait = Generator[None, None, None]
Vector6 = Float[np.ndarray, "6"]
LATE_TIME = 0.1
"""A servo target that the joints could not reach in so long counts as a jump [s]: a client may miss
some periods."""
SPEEDL_TIME = 0.5
"""How long a speedl without a time is waited for [s]."""
SLOWEST_STOP = 0.1
"""Deceleration of the leading joint that a stop has at least [rad/s^2]."""
LONGEST_SLEEP = 1e6
"""[s]"""


def motion_functions(controller: Controller) -> Iterable[Function]:
    """Their rows; accelerations, speeds and times in rad, m and s, with the manual's defaults."""
    moves = _Moves(controller)
    joint_a, joint_v = Parameter("a", POSITIVE, 1.4), Parameter("v", POSITIVE, 1.05)
    tool_a, tool_v = Parameter("a", POSITIVE, 1.2), Parameter("v", POSITIVE, 0.25)
    t, r = Parameter("t", NUMBER, 0.0), Parameter("r", NUMBER, 0.0)
    until, rotation_a = Parameter("t", NUMBER, None), Parameter("aRot", NUMBER, 0.0)
    unused_a, unused_v = Parameter("a", NUMBER, 0.0), Parameter("v", NUMBER, 0.0)
    rows = (
        row("movej", moves.movej, Parameter("q", PLACE), joint_a, joint_v, t, r),
        row("movel", moves.movel, Parameter("pose", PLACE), tool_a, tool_v, t, r),
        row("movep", moves.movel, Parameter("pose", PLACE), tool_a, tool_v, t, r),
        row("servoc", moves.movel, Parameter("pose", PLACE), tool_a, tool_v, r),
        row(
            "servoj",
            moves.servoj,
            Parameter("q", JOINTS),
            unused_a,
            unused_v,
            Parameter("t", NUMBER, PERIOD),
            Parameter("lookahead_time", NUMBER, 0.1),
            Parameter("gain", NUMBER, 300.0),
        ),
        row("speedj", moves.speedj, Parameter("qd", JOINTS), joint_a, until),
        row("speedl", moves.speedl, Parameter("xd", JOINTS), tool_a, until, rotation_a),
        row("stopj", moves.stopj, Parameter("a", NUMBER, 2.0)),
        row("stopl", moves.stopl, Parameter("a", NUMBER, 1.2), rotation_a),
        *direct_torque(controller),
    )
    yield from (row(r.name, _owned(controller, r.call), *r.parameters, waits=True) for r in rows)
    yield row("sync", _sync, waits=True)
    yield row("sleep", _sleep, Parameter("t", NUMBER), waits=True)


def _sync() -> Wait:
    """Wait for the next period."""
    yield


def _sleep(seconds: float) -> Wait:
    """Wait so long, for a period at least."""
    for _ in range(max(round(min(seconds, LONGEST_SLEEP) / PERIOD), 1)):
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

    def movej(self, x: Pose | Vector6, a: float, v: float, t: float, r: float) -> Wait:
        """In joint space; `t` and `r` are not simulated."""
        q = inverse(self._controller, x) if isinstance(x, Pose) else x
        if not np.abs(q).max() <= ANGLE_LIMIT:
            raise ScriptError(f"movej to {q.round(4).tolist()}: beyond the joints' limits", q)
        yield from self._arrive(lambda: motion.joint_travel(self._robot, q, v, a))

    def movel(self, x: Pose | Vector6, a: float, v: float, *_: float) -> Wait:
        """Straight in space."""
        controller = self._controller
        X_BT = x.matrix if isinstance(x, Pose) else controller.tool_pose(x)
        inverse(controller, Pose.of(X_BT))
        arm = self._robot.calibration
        yield from self._arrive(
            lambda: motion.straight_travel(self._robot, arm, X_BT, controller.X_FT, v, a)
        )

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
        yield from _sleep(t)

    def speedj(self, qd: Vector6, a: float, t: float | None) -> Wait:
        """At joint speeds; without a time, until they are reached."""
        controller, robot = self._controller, self._robot
        controller.motion = JointSpeed(qd, a)
        if t is not None:
            yield from _sleep(t)
            return
        yield
        while np.abs(robot.commanded[1] - controller.scaling * qd).max() > 1e-6:
            yield

    def speedl(self, xd: Vector6, a: float, t: float | None, rotation_a: float) -> Wait:
        """At a velocity of the tool."""
        controller = self._controller
        controller.motion = ToolSpeed(self._robot.calibration, controller.X_FT, xd, a)
        yield from _sleep(SPEEDL_TIME if t is None else t)

    def stopj(self, a: float) -> Wait:
        """To rest."""
        controller = self._controller
        mine = controller.motion = Braking(self._robot, max(a, SLOWEST_STOP))
        yield
        while controller.motion is mine:
            yield

    def stopl(self, a: float, rotation_a: float) -> Wait:
        """The same at a deceleration of the tool."""
        # about so much of the leading joint, for a tool half a metre away
        yield from self.stopj(2 * a)

    def _arrive(self, plan: Callable[[], Motion]) -> Wait:
        """Move, and wait until that is done; after a pause again, from wherever the arm is then."""
        controller = self._controller
        mine = controller.motion = plan()
        while True:
            yield
            if controller.motion is motion.hold:
                return
            if controller.motion is not mine and not isinstance(controller.motion, Braking):
                return
            if controller.motion is not mine:
                mine = controller.motion = plan()
