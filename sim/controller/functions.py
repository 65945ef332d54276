"""The functions of the controller that programs call, as rows of tables: name, what it does,
parameters.

A name that no row has is refused where a program calls it. `motion_functions` holds those that take
time.
"""

import math
from collections.abc import Callable, Generator, Iterable

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD
from sim.controller.controller import Controller
from sim.controller.force_functions import force_functions
from sim.controller.kinematics import inverse, reaching
from sim.controller.motion_functions import motion_functions
from sim.controller.urscript.library import library
from sim.controller.urscript.signature import (
    ANYTHING,
    CONDITION,
    INTEGER,
    JOINTS,
    NUMBER,
    PLACE,
    POSE,
    REFUSED,
    TEXT,
    VECTOR,
    Function,
    Kind,
    Parameter,
    choice,
    row,
    table,
    whole,
)
from sim.controller.urscript.values import Pose, ScriptError, Value, is_number
from sim.controller.variables import INPUTS, REGISTERS

AT_REST = 1e-3
"""Joint speed below which the arm is steady [rad/s]."""
CONTACT_FORCE = 5.0
"""Force that counts as contact of the tool [N]."""
HEAVIEST = 5.0
"""Payload of a UR5e [kg] [UR-limits]."""
Vector6 = Float[np.ndarray, "6"]
INPUT = Kind("the name of an input", lambda value: value if value in INPUTS else REFUSED)


def script_functions(controller: Controller) -> dict[str, Function]:
    """All of them by name."""
    subjects = (
        library(),
        motion_functions(controller),
        _mathematics(),
        _registers(controller),
        _readings(controller),
        force_functions(controller),
        _settings(controller),
        _unsimulated(),
        _poses(),
        _kinematics(controller),
    )
    return table(function for subject in subjects for function in subject)


def _mathematics() -> Iterable[Function]:
    x, y = Parameter("x", NUMBER), Parameter("y", NUMBER)
    one = {
        "sin": math.sin,
        "cos": math.cos,
        "tan": math.tan,
        "asin": math.asin,
        "acos": math.acos,
        "atan": math.atan,
        "sqrt": math.sqrt,
        "floor": math.floor,
        "ceil": math.ceil,
        "d2r": math.radians,
        "r2d": math.degrees,
    }
    yield from (row(name, compute, x) for name, compute in one.items())
    yield row("atan2", math.atan2, x, y)
    yield row("pow", math.pow, x, y)
    yield row("norm", _norm, Parameter("a", ANYTHING), costly=True)


def _norm(value: Value) -> float:
    numbers = value if isinstance(value, tuple) else (value,)
    if not all(map(is_number, numbers)):
        raise ScriptError("norm: a is a number or a list of numbers", value)
    return math.hypot(*numbers)


def _registers(controller: Controller) -> Iterable[Function]:
    place = Parameter("port_id", whole(0, REGISTERS - 1))
    doubles, ints = (
        [f"input_{kind}_register_{i}" for i in range(REGISTERS)] for kind in ("double", "int")
    )

    def write_float(i: int, value: float) -> None:
        controller.out_doubles[i] = float(value)

    def write_integer(i: int, value: int) -> None:
        controller.out_ints[i] = value

    yield row("read_input_float_register", lambda i: controller.read_input(doubles[i]), place)
    yield row("read_input_integer_register", lambda i: controller.read_input(ints[i]), place)
    yield row("write_output_float_register", write_float, place, Parameter("value", NUMBER))
    yield row("write_output_integer_register", write_integer, place, Parameter("value", INTEGER))
    yield row(
        "write_output_boolean_register", lambda i, value: None,
        Parameter("port_id", whole(0, 127)), Parameter("value", CONDITION),
    )  # fmt: skip


def _readings(controller: Controller) -> Iterable[Function]:
    robot, arm = controller.robot, controller.robot.calibration

    def history(steps: int) -> tuple[float, ...]:
        return tuple(controller.history[max(-len(controller.history), -1 - steps)].tolist())

    def touches(direction: Vector6) -> int:
        return int(np.linalg.norm(controller.tool_wrench_B()[:3]) > CONTACT_FORCE)

    def is_steady() -> bool:
        return bool(
            max(np.abs(controller.state.qd).max(), np.abs(robot.commanded[1]).max()) < AT_REST
        )

    arrays: dict[str, Callable[[], np.ndarray]] = {
        "get_actual_joint_positions": lambda: controller.state.q,
        "get_actual_joint_speeds": lambda: controller.state.qd,
        "get_target_joint_positions": lambda: robot.commanded[0],
        "get_target_joint_speeds": lambda: robot.commanded[1],
        "get_target_joint_accelerations": lambda: robot.commanded_acceleration,
        "get_actual_tcp_speed": lambda: controller.tool_speed(
            controller.state.q, controller.state.qd
        ),
        "get_target_tcp_speed": lambda: controller.tool_speed(*robot.commanded),
        "get_tcp_force": controller.tool_wrench_B,
        "get_joint_torques": robot.drive_torques,
    }
    poses: dict[str, Callable[[], np.ndarray]] = {
        "get_actual_tcp_pose": lambda: controller.tool_pose(controller.state.q),
        "get_target_tcp_pose": lambda: controller.tool_pose(robot.commanded[0]),
        "get_target_waypoint": lambda: controller.tool_pose(robot.commanded[0]),
        "get_actual_tool_flange_pose": lambda: arm.forward(controller.state.q),
        "get_tcp_offset": lambda: controller.X_FT,
    }
    yield from (
        row(name, lambda read=read: tuple(read().tolist()), costly=True)
        for name, read in arrays.items()
    )
    yield from (
        row(name, lambda read=read: Pose.of(read()), costly=True) for name, read in poses.items()
    )
    yield row("get_steptime", lambda: PERIOD)
    yield row(
        "get_actual_joint_positions_history", history, Parameter("steps", whole(0, 2**31 - 1), 0)
    )
    yield row("force", lambda: float(np.linalg.norm(controller.tool_wrench_B()[:3])), costly=True)
    yield row("tool_contact", touches, Parameter("direction", JOINTS, None), costly=True)
    yield row("is_steady", is_steady, costly=True)


def _settings(controller: Controller) -> Iterable[Function]:
    mass, cog = Parameter("m", NUMBER), Parameter("cog", VECTOR, None)
    inertia = Parameter("inertia", JOINTS, None)

    def set_tcp(pose: Pose, name: str) -> None:
        controller.X_FT = pose.matrix

    def set_payload(
        m: float, cog: np.ndarray | None, inertia: np.ndarray | None, over: float = 0.0
    ) -> None:
        if not 0 <= m <= HEAVIEST:
            raise ScriptError(f"a payload has 0 to {HEAVIEST} kg, got {m}", m)
        centre_F = controller.payload.centre_F if cog is None else cog
        controller.set_payload(float(m), centre_F, over)
        if inertia is not None:
            controller.inertia = inertia.tolist()

    def set_watchdog(variable: str, min_frequency: float, action: str) -> None:
        if action == "ignore" or min_frequency <= 0:
            controller.watchdogs.pop(variable, None)
        else:
            controller.arm_watchdog(variable, 1 / min_frequency, stops=action == "stop")

    def protective_stop() -> Generator[None, None, None]:
        controller.protective_stop("the program asks for it")
        yield

    yield row(
        "set_tcp", set_tcp, Parameter("pose", POSE), Parameter("tcp_name", TEXT, ""), costly=True
    )
    yield row("set_payload", set_payload, mass, cog, inertia, costly=True)
    yield row(
        "set_target_payload",
        set_payload,
        mass,
        cog,
        inertia,
        Parameter("transition_time", NUMBER, 0.0),
        costly=True,
    )
    yield row("get_target_payload", lambda: controller.payload.mass)
    yield row("get_target_payload_cog", lambda: tuple(controller.payload.centre_F.tolist()))
    yield row("get_target_payload_inertia", lambda: tuple(controller.inertia))
    yield row("zero_ftsensor", controller.zero_wrench)
    yield row(
        "rtde_set_watchdog",
        set_watchdog,
        Parameter("variable_name", INPUT),
        Parameter("min_frequency", NUMBER),
        Parameter("action", choice("ignore", "pause", "stop"), "pause"),
    )
    yield row("protective_stop", protective_stop, waits=True)


def _unsimulated() -> Iterable[Function]:
    """Taken, checked, and without effect here."""
    message = (Parameter("s1", ANYTHING), Parameter("s2", ANYTHING, ""))
    sensor = (
        Parameter("enable", CONDITION), Parameter("sensor_mass", NUMBER, 0.0),
        Parameter("sensor_measuring_offset", VECTOR, None), Parameter("sensor_cog", VECTOR, None),
    )  # fmt: skip
    rows: dict[str, tuple[Parameter, ...]] = {
        "textmsg": message,
        "popup": (
            Parameter("s", ANYTHING),
            Parameter("title", TEXT, ""),
            Parameter("warning", CONDITION, False),
            Parameter("error", CONDITION, False),
            Parameter("blocking", CONDITION, False),
        ),
        "set_gravity": (Parameter("d", VECTOR),),
        "ft_rtde_input_enable": sensor,
        "enable_external_ft_sensor": sensor,
    }
    yield from (row(name, lambda *_: None, *parameters) for name, parameters in rows.items())


def _poses() -> Iterable[Function]:
    def added(a: Pose, b: Pose, sign: float) -> Pose:
        """Positions and rotations apart, as the script language adds poses."""
        A, B = a.matrix, b.matrix
        R = B[:3, :3] if sign > 0 else B[:3, :3].T
        return Pose.of(se3.pose(A[:3, :3] @ R, A[:3, 3] + sign * B[:3, 3]))

    first, second = Parameter("p_1", POSE), Parameter("p_2", POSE)
    start, step = Parameter("p_from", POSE), Parameter("p_from_to", POSE)
    yield row("pose_trans", lambda a, b: Pose.of(a.matrix @ b.matrix), start, step, costly=True)
    yield row(
        "pose_inv", lambda a: Pose.of(se3.inverse(a.matrix)), Parameter("p_from", POSE), costly=True
    )
    yield row("pose_add", lambda a, b: added(a, b, 1.0), first, second, costly=True)
    yield row("pose_sub", lambda a, b: added(a, b, -1.0), first, second, costly=True)


def _kinematics(controller: Controller) -> Iterable[Function]:
    near = Parameter("qnear", JOINTS, None)
    tolerances = (
        near,
        Parameter("maxPositionError", NUMBER, 0.0),
        Parameter("maxOrientationError", NUMBER, 0.0),
    )

    def forward(q: Vector6 | None, tcp: Pose | None) -> Pose:
        joints = controller.state.q if q is None else q
        X_FT = controller.X_FT if tcp is None else tcp.matrix
        return Pose.of(controller.robot.calibration.forward(joints) @ X_FT)

    def has_solution(x: Pose, *_: object) -> bool:
        return bool(reaching(controller, x).size)

    def is_within_limits(x: Pose | Vector6, *_: object) -> bool:
        return has_solution(x) if isinstance(x, Pose) else bool(np.abs(x).max() <= ANGLE_LIMIT)

    def solve(x: Pose, qnear: Vector6 | None, *_: object) -> tuple[float, ...]:
        return tuple(inverse(controller, x, qnear).tolist())

    yield row(
        "get_forward_kin",
        forward,
        Parameter("q", JOINTS, None),
        Parameter("tcp", POSE, None),
        costly=True,
    )
    yield row("get_inverse_kin", solve, Parameter("x", POSE), *tolerances, costly=True)
    yield row(
        "get_inverse_kin_has_solution", has_solution, Parameter("x", POSE), *tolerances, costly=True
    )
    yield row(
        "is_within_safety_limits", is_within_limits, Parameter("pose", PLACE), near, costly=True
    )
