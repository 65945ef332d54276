"""The functions that URScript programs call, acting on the simulated controller."""

import math
from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.robot.targets import ANGLE_LIMIT, SPEED_LIMIT, SPEED_TOLERANCE
from sim.controller import motion
from sim.controller.motion import Braking, JointSpeed, Motion, Servo, ToolSpeed
from sim.controller.urscript import ScriptError
from sim.controller.variables import REGISTERS
from sim.servo import GAIN_RANGE, LOOKAHEAD_RANGE, PERIOD

if TYPE_CHECKING:
    from sim.controller.controller import Controller

Wait = Generator[None, None, None]
AT_REST = 1e-3
"""Joint speed below which the arm is steady [rad/s]."""
CONTACT_FORCE = 5.0
"""Force that counts as contact of the tool [N]."""
LATE_TIME = 0.1
"""A servo target that the joints could not reach in so long counts as a jump [s]: a client may miss some periods."""
SPEEDL_TIME = 0.5
"""How long a speedl without a time is waited for [s]."""


class Pose(list[float]):
    """`p[x, y, z, rx, ry, rz]`; a plain list is joint angles."""

    @staticmethod
    def of(X: Float[np.ndarray, "4 4"]) -> "Pose":
        """That of a transform."""
        return Pose([*X[:3, 3].tolist(), *se3.rotation_vector(X).tolist()])

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """As a transform."""
        return se3.from_rotation_vector(np.array(self[3:], float), np.array(self[:3], float))


def as_pose(values: list[float]) -> Pose:
    """A pose, also where a program has it in a plain list."""
    return values if isinstance(values, Pose) else Pose(values)


def script_functions(controller: "Controller") -> tuple[dict[str, Callable], frozenset[str]]:
    """All of them by name, and the names of those that wait."""
    waiting = {**_motions(controller), **_waits()}
    immediate = {
        **_mathematics(), **_registers(controller), **_readings(controller), **_settings(controller),
        **_poses(), **_kinematics(controller),
    }  # fmt: skip
    return {"__pose": Pose, **immediate, **waiting}, frozenset(waiting)


def _waits() -> dict[str, Callable[..., Wait]]:
    def sync() -> Wait:
        yield

    return {"sync": sync, "sleep": _sleep}


def _sleep(seconds: float) -> Wait:
    """Wait so long, for a period at least."""
    for _ in range(max(round(seconds / PERIOD), 1)):
        yield


def _motions(controller: "Controller") -> dict[str, Callable[..., Wait]]:
    robot, arm = controller.robot, controller.robot.calibration

    def owned(move: Callable[..., Wait]) -> Callable[..., Wait]:
        """One thread moves the arm at a time."""

        def run(*arguments: Any, **named: Any) -> Wait:
            assert controller.program is not None, "only programs move the arm"
            me = controller.program.current
            if controller.owner not in (None, me) and controller.owner.alive:
                raise ScriptError("another thread is already controlling the robot")
            controller.owner = me
            try:
                yield from move(*arguments, **named)
            finally:
                if controller.owner is me:
                    controller.owner = None

        return run

    def arrive(plan: Callable[[], Motion]) -> Wait:
        """Move, and wait until that is done; after a pause again, from wherever the arm is then."""
        mine = controller.motion = plan()
        while True:
            yield
            if controller.motion is motion.hold:
                return
            if controller.motion is not mine and not isinstance(controller.motion, Braking):
                return
            if controller.motion is not mine:
                mine = controller.motion = plan()

    def goal(x: list[float]) -> Float[np.ndarray, "6"]:
        return _inverse(controller, x, None) if isinstance(x, Pose) else np.array(x, float)

    def movej(x: list[float], a: float = 1.4, v: float = 1.05, t: float = 0, r: float = 0) -> Wait:
        q = goal(x)
        if not np.abs(q).max() <= ANGLE_LIMIT:
            raise ScriptError(f"movej to {q}: beyond the joints' limits")
        yield from arrive(lambda: motion.joint_travel(robot, q, v, a))

    def movel(x: list[float], a: float = 1.2, v: float = 0.25, t: float = 0, r: float = 0) -> Wait:
        X_BT = x.matrix if isinstance(x, Pose) else controller.tool_pose(np.array(x, float))
        _inverse(controller, Pose.of(X_BT), None)
        yield from arrive(lambda: motion.straight_travel(robot, arm, X_BT, controller.X_FT, v, a))

    def servoj(
        q: list[float], a: float = 0, v: float = 0, t: float = PERIOD, lookahead_time: float = 0.1, gain: float = 300
    ) -> Wait:
        target = np.array(q, float)
        last = controller.motion.q if isinstance(controller.motion, Servo) else robot.course[0]
        if (
            not np.abs(target).max() <= ANGLE_LIMIT
            or np.abs(target - last).max() > SPEED_TOLERANCE * LATE_TIME * SPEED_LIMIT
        ):
            controller.protective_stop("servoj: the target is too far away")
            yield
            return
        robot.tune_servo(min(max(lookahead_time, LOOKAHEAD_RANGE[0]), LOOKAHEAD_RANGE[1]),
                         min(max(gain, GAIN_RANGE[0]), GAIN_RANGE[1]))  # fmt: skip
        if isinstance(controller.motion, Servo):
            controller.motion.q = target
        else:
            controller.motion = Servo(target)
        yield from _sleep(t)

    def speedj(qd: list[float], a: float = 1.4, t: float | None = None) -> Wait:
        wanted = np.array(qd, float)
        controller.motion = JointSpeed(wanted, a)
        if t is not None:
            yield from _sleep(t)
            return
        yield
        while np.abs(robot.course[1] - controller.scaling * wanted).max() > 1e-6:
            yield

    def speedl(xd: list[float], a: float = 1.2, t: float | None = None, aRot: float = 0) -> Wait:
        controller.motion = ToolSpeed(arm, controller.X_FT, np.array(xd, float), a)
        yield from _sleep(SPEEDL_TIME if t is None else t)

    def stopj(a: float = 2.0) -> Wait:
        mine = controller.motion = Braking(robot, max(a, 0.1))
        yield
        while controller.motion is mine:
            yield

    def stopl(a: float = 1.2, aRot: float = 0) -> Wait:
        yield from stopj(2 * a)  # about so much of the leading joint, for a tool half a metre away

    def servoc(x: list[float], a: float = 1.2, v: float = 0.25, r: float = 0) -> Wait:
        yield from movel(x, a, v)

    def direct_torque(*_: object, **__: object) -> Wait:
        yield  # taken, and not simulated

    moves = {
        "movej": movej, "movel": movel, "movep": movel, "servoj": servoj, "servoc": servoc, "speedj": speedj,
        "speedl": speedl, "stopj": stopj, "stopl": stopl, "direct_torque": direct_torque,
    }  # fmt: skip
    return {name: owned(move) for name, move in moves.items()}


def _mathematics() -> dict[str, Callable]:
    def norm(x: Any) -> float:
        return abs(x) if isinstance(x, int | float) else math.sqrt(sum(value**2 for value in x))

    names = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "floor", "ceil")
    return {name: getattr(math, name) for name in names} | {
        "norm": norm, "pow": pow, "d2r": math.radians, "r2d": math.degrees, "length": len, "to_str": str,
    }  # fmt: skip


def _registers(controller: "Controller") -> dict[str, Callable]:
    doubles, ints = ([f"input_{kind}_register_{i}" for i in range(REGISTERS)] for kind in ("double", "int"))

    def write_float(i: int, value: float) -> None:
        controller.out_doubles[i] = float(value)

    def write_integer(i: int, value: int) -> None:
        controller.out_ints[i] = int(value)

    return {
        "read_input_float_register": lambda i: controller.inputs[doubles[i]],
        "read_input_integer_register": lambda i: controller.inputs[ints[i]],
        "write_output_float_register": write_float,
        "write_output_integer_register": write_integer,
        "write_output_boolean_register": lambda i, value: None,
    }


def _readings(controller: "Controller") -> dict[str, Callable]:
    robot, arm = controller.robot, controller.robot.calibration

    def history(steps: int = 0) -> list[float]:
        return controller.history[max(-len(controller.history), -1 - int(steps))].tolist()

    return {
        "get_steptime": lambda: PERIOD,
        "get_actual_joint_positions": lambda: robot.state().q.tolist(),
        "get_actual_joint_positions_history": history,
        "get_actual_joint_speeds": lambda: robot.state().qd.tolist(),
        "get_target_joint_positions": lambda: robot.course[0].tolist(),
        "get_target_joint_speeds": lambda: robot.course[1].tolist(),
        "get_target_joint_accelerations": lambda: robot.course_change.tolist(),
        "get_actual_tcp_pose": lambda: Pose.of(controller.tool_pose(robot.state().q)),
        "get_target_tcp_pose": lambda: Pose.of(controller.tool_pose(robot.course[0])),
        "get_target_waypoint": lambda: Pose.of(controller.tool_pose(robot.course[0])),
        "get_actual_tool_flange_pose": lambda: Pose.of(arm.forward(robot.state().q)),
        "get_actual_tcp_speed": lambda: controller.tool_speed(robot.state().q, robot.state().qd).tolist(),
        "get_target_tcp_speed": lambda: controller.tool_speed(*robot.course).tolist(),
        "get_tcp_force": lambda: controller.tool_wrench_B().tolist(),
        "force": lambda: float(np.linalg.norm(controller.tool_wrench_B()[:3])),
        "tool_contact": lambda *_, **__: int(np.linalg.norm(controller.tool_wrench_B()[:3]) > CONTACT_FORCE),
        "get_joint_torques": lambda: robot.drive_torques().tolist(),
        "get_mass_matrix": lambda *_, **__: robot.mass_matrix(),
        "get_coriolis_and_centrifugal_torques": lambda *_, **__: [0.0] * 6,
        "get_jacobian": lambda *_, **__: motion.tool_jacobian(arm, robot.state().q, controller.X_FT[:3, 3]),
        "get_jacobian_time_derivative": lambda *_, **__: np.zeros((6, 6)),
        "is_steady": lambda: bool(max(np.abs(robot.state().qd).max(), np.abs(robot.course[1]).max()) < AT_REST),
        "get_freedrive_status": lambda: int(controller.freedrive),
    }


def _settings(controller: "Controller") -> dict[str, Callable]:
    def set_tcp(pose: list[float], *_: object) -> None:
        controller.X_FT = as_pose(pose).matrix

    def set_payload(
        mass: float, cog: list[float] | None = None, inertia: list[float] | None = None, *_: object
    ) -> None:
        controller.set_payload(float(mass), controller.payload.centre_F if cog is None else np.array(cog, float))
        if inertia is not None:
            controller.inertia = [float(value) for value in inertia]

    def rtde_set_watchdog(variable: str, min_frequency: float, action: str = "pause") -> None:
        if action == "ignore" or min_frequency <= 0:
            controller.watchdogs.pop(variable, None)
        else:
            controller.watch(variable, 1 / min_frequency, stops=action == "stop")

    def free(on: bool) -> Callable[..., None]:
        return lambda *_, **__: setattr(controller, "freedrive", on)

    def halt() -> None:
        raise ScriptError("halt")

    ignored = (
        "textmsg", "popup", "set_gravity", "force_mode", "end_force_mode", "force_mode_set_damping",
        "force_mode_set_gain_scaling", "ft_rtde_input_enable", "enable_external_ft_sensor",
    )  # fmt: skip
    return dict.fromkeys(ignored, lambda *_, **__: None) | {
        "set_tcp": set_tcp,
        "get_tcp_offset": lambda: Pose.of(controller.X_FT),
        "set_payload": set_payload,
        "set_target_payload": set_payload,
        "get_target_payload": lambda: controller.payload.mass,
        "get_target_payload_cog": lambda: controller.payload.centre_F.tolist(),
        "get_target_payload_inertia": lambda: list(controller.inertia),
        "zero_ftsensor": controller.robot.zero_wrench,
        "rtde_set_watchdog": rtde_set_watchdog,
        "protective_stop": lambda: controller.protective_stop("the program asks for it"),
        "teach_mode": free(True),
        "end_teach_mode": free(False),
        "freedrive_mode": free(True),
        "end_freedrive_mode": free(False),
        "halt": halt,
    }


def _poses() -> dict[str, Callable]:
    def added(a: list[float], b: list[float], sign: float) -> Pose:
        """Positions and turns apart, as the script language adds poses."""
        A, B = as_pose(a).matrix, as_pose(b).matrix
        R = B[:3, :3] if sign > 0 else B[:3, :3].T
        return Pose.of(se3.pose(A[:3, :3] @ R, A[:3, 3] + sign * B[:3, 3]))

    return {
        "pose_trans": lambda a, b: Pose.of(as_pose(a).matrix @ as_pose(b).matrix),
        "pose_inv": lambda a: Pose.of(se3.inverse(as_pose(a).matrix)),
        "pose_add": lambda a, b: added(a, b, 1.0),
        "pose_sub": lambda a, b: added(a, b, -1.0),
    }


def _kinematics(controller: "Controller") -> dict[str, Callable]:
    def forward(q: list[float] | None = None, tcp: list[float] | None = None) -> Pose:
        joints = controller.robot.state().q if q is None else np.array(q, float)
        X_FT = controller.X_FT if tcp is None else as_pose(tcp).matrix
        return Pose.of(controller.robot.calibration.forward(joints) @ X_FT)

    def has_solution(x: list[float], qnear: list[float] | None = None, *_: object) -> bool:
        return bool(_reaching(controller, x).size)

    def is_within_safety_limits(x: list[float]) -> bool:
        return has_solution(x) if isinstance(x, Pose) else max(abs(angle) for angle in x) <= ANGLE_LIMIT

    return {
        "get_forward_kin": forward,
        "get_inverse_kin": lambda x, qnear=None, *_, **__: _inverse(controller, x, qnear).tolist(),
        "get_inverse_kin_has_solution": has_solution,
        "is_within_safety_limits": is_within_safety_limits,
    }


def _reaching(controller: "Controller", x: list[float]) -> Float[np.ndarray, "k 6"]:
    """All joint angles that take the tool to a pose [rad]."""
    X_BF = as_pose(x).matrix @ se3.inverse(controller.X_FT)
    return controller.robot.calibration.inverse(X_BF)


def _inverse(controller: "Controller", x: list[float], near: list[float] | None) -> Float[np.ndarray, "6"]:
    """The solution nearest to joint angles, whole turns included; by default to where the arm is [rad]."""
    start = controller.robot.course[0] if near is None else np.array(near, float)
    solutions = _reaching(controller, x)
    if not solutions.size:
        raise ScriptError(f"no joint angles reach {[round(value, 4) for value in x]}")
    turns = (solutions - start + np.pi) % (2 * np.pi) - np.pi
    return start + turns[np.abs(turns).max(axis=1).argmin()]
