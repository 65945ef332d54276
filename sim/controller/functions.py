"""The functions of the controller that programs call, as rows of tables: name, what it does,
parameters.

A name that no row has is refused where a program calls it. `motion_functions` holds those that take
time.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD
from sim.controller.config import ControllerConfig
from sim.controller.controller import Controller
from sim.controller.force_functions import force_functions
from sim.controller.io_functions import io_functions
from sim.controller.kinematics import inverse, reaching
from sim.controller.math_functions import math_functions
from sim.controller.motion_functions import motion_functions
from sim.controller.operator_functions import operator_functions
from sim.controller.outputs import TEMPERATURE, Outputs
from sim.controller.rpc_functions import rpc_functions
from sim.controller.socket_functions import socket_functions
from sim.controller.urscript.library import library
from sim.controller.urscript.signature import (
    CONDITION,
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
from sim.controller.urscript.values import LARGEST_INTEGER, Pose, ScriptError
from sim.controller.variables import INPUTS, OUTPUTS
from sim.robot import SimRobot

AT_REST = 1e-3
"""Joint speed below which the arm is steady [rad/s]."""
CONTACT_FORCE = 5.0
"""Force that counts as contact of the tool [N]."""
HEAVIEST = 5.0
"""Payload of a UR5e [kg] [UR-limits]."""
UP = (0.0, 0.0, 9.82)
"""The acceleration that an arm that stands upright experiences, as programs say it [m/s^2]."""
UPRIGHT = 0.02
"""Tangent of the angle by which a program's gravity may deviate [-]: a base that is not quite
level."""
Vector3 = Float[np.ndarray, "3"]
Vector6 = Float[np.ndarray, "6"]
OUTPUT = Kind(
    "the name of an output", lambda v: v if isinstance(v, str) and v in OUTPUTS else REFUSED
)
INPUT = Kind("the name of an input", lambda v: v if isinstance(v, str) and v in INPUTS else REFUSED)


def switched_on(
    robot: SimRobot,
    config: ControllerConfig,
    mount_angle: float,
    tell: Callable[[str], None] = lambda text: None,
) -> Controller:
    """A controller with all that its programs can call; arguments as `Controller` takes them."""
    controller = Controller(robot, config, mount_angle, tell)
    controller.functions = script_functions(controller)
    return controller


def script_functions(controller: Controller) -> dict[str, Function]:
    """All of them by name."""
    subjects = (
        library(),
        motion_functions(controller),
        socket_functions(controller),
        rpc_functions(controller),
        math_functions(),
        io_functions(controller),
        operator_functions(controller),
        _readings(controller),
        force_functions(controller),
        _settings(controller),
        _without_effect(),
        _kinematics(controller),
    )
    return table(function for subject in subjects for function in subject)


def _readings(controller: Controller) -> Iterable[Function]:
    robot, arm = controller.robot, controller.robot.calibration
    outputs = Outputs(controller)

    def output(key: str) -> Any:
        values = outputs.reader([key])()
        return tuple(values) if outputs.width(key) > 1 else values[0]

    def history(steps: int) -> tuple[float, ...]:
        return tuple(controller.history[max(-len(controller.history), -1 - steps)].tolist())

    def touches(direction: Vector6) -> int:
        force_B, way_B = controller.tool_wrench_B()[:3], direction[:3]
        length = float(np.linalg.norm(way_B))
        against = -force_B @ way_B / length if length > 0 else np.linalg.norm(force_B)
        return int(against > CONTACT_FORCE)

    def is_steady() -> bool:
        return bool(np.abs([controller.state.qd, robot.commanded[1]]).max() < AT_REST)

    arrays: dict[str, Callable[[], np.ndarray]] = {
        "get_actual_joint_positions": lambda: controller.state.q,
        "get_actual_joint_speeds": lambda: controller.state.qd,
        "get_target_joint_positions": lambda: robot.commanded[0],
        "get_joint_positions": lambda: robot.commanded[0],
        "get_target_joint_speeds": lambda: robot.commanded[1],
        "get_target_joint_accelerations": lambda: robot.commanded_acceleration,
        "get_actual_tcp_speed": lambda: controller.tool_speed(
            controller.state.q, controller.state.qd
        ),
        **dict.fromkeys(
            ("get_target_tcp_speed", "get_target_tcp_speed_along_path"),
            lambda: controller.tool_speed(*robot.commanded),
        ),
        "get_tool_accelerometer_reading": lambda: arm.forward(controller.state.q)[:3, :3].T @ UP,
        "get_tcp_force": controller.tool_wrench_B,
        "get_joint_torques": robot.drive_torques,
    }
    poses: dict[str, Callable[[], np.ndarray]] = {
        "get_actual_tcp_pose": lambda: controller.tool_pose(controller.state.q),
        **dict.fromkeys(
            ("get_target_tcp_pose", "get_target_tcp_pose_along_path", "tool_pose"),
            lambda: controller.tool_pose(robot.commanded[0]),
        ),
        "get_actual_tool_flange_pose": lambda: arm.forward(controller.state.q),
        "get_tcp_offset": lambda: controller.X_FT,
    }
    for name, read in arrays.items():
        yield row(name, lambda read=read: tuple(read().tolist()), costly=True)
    for name, read in poses.items():
        yield row(name, lambda read=read: Pose.of(read()), costly=True)
    yield row("get_rtde_value", output, Parameter("key", OUTPUT), costly=True)
    yield row("get_steptime", lambda: PERIOD)
    yield from (row(name, lambda: TEMPERATURE) for name in ("get_controller_temp", "get_tool_temp"))
    yield row("get_joint_temp", lambda j: TEMPERATURE, Parameter("j", whole(0, 5)))
    yield row("get_tool_current", lambda: 0.0)
    steps = Parameter("steps", whole(0, LARGEST_INTEGER), 0)
    yield row("get_actual_joint_positions_history", history, steps)
    yield row("force", lambda: float(np.linalg.norm(controller.tool_wrench_B()[:3])), costly=True)
    yield row("tool_contact", touches, Parameter("direction", JOINTS, np.zeros(6)), costly=True)
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

    pose, name = Parameter("pose", POSE), Parameter("tcp_name", TEXT, "")
    yield row("set_tcp", set_tcp, pose, name, costly=True)
    yield row("set_payload", set_payload, mass, cog, inertia, costly=True)
    yield row("set_target_payload", set_payload, mass, cog, inertia,
              Parameter("transition_time", NUMBER, 0.0), costly=True)  # fmt: skip
    yield row("get_target_payload", lambda: controller.payload.mass)
    yield row("get_target_payload_cog", lambda: tuple(controller.payload.centre_F.tolist()))
    yield row("get_target_payload_inertia", lambda: tuple(controller.inertia))
    yield row("zero_ftsensor", controller.zero_wrench)
    action = Parameter("action", choice("ignore", "pause", "stop"), "pause")
    yield row("rtde_set_watchdog", set_watchdog, Parameter("variable_name", INPUT),
              Parameter("min_frequency", NUMBER), action)  # fmt: skip
    yield row(
        "protective_stop",
        lambda: controller.protective_stop("the program asks for it"),
        costly=True,
    )


def _without_effect() -> Iterable[Function]:
    """Settings that the twin has as they are, and refuses to have otherwise."""

    def nothing(*_: object) -> None:
        """What is asked for is so."""

    def set_gravity(d: Vector3) -> None:
        if not np.linalg.norm(np.cross(d, UP)) < UPRIGHT * d[2]:
            raise ScriptError(f"set_gravity: the simulated arm stands upright, got {d.tolist()}", d)

    def refusing(name: str, why: str) -> Callable[..., None]:
        def call(on: bool, *_: object) -> None:
            if on:
                raise ScriptError(f"{name}: {why}")

        return call

    sensor = (
        Parameter("enable", CONDITION), Parameter("sensor_mass", NUMBER, 0.0),
        Parameter("sensor_measuring_offset", VECTOR, None), Parameter("sensor_cog", VECTOR, None),
    )  # fmt: skip
    for name in ("ft_rtde_input_enable", "enable_external_ft_sensor"):
        yield row(name, refusing(name, "the sensor in the wrist is the only one"), *sensor)
    warning, enabled = "position_deviation_warning", Parameter("enabled", CONDITION)
    yield row(warning, refusing(warning, "warnings are not simulated, stops are"), enabled,
              Parameter("threshold", NUMBER, 0.8))  # fmt: skip
    yield row("set_gravity", set_gravity, Parameter("d", VECTOR), costly=True)
    yield row("get_gravity", lambda: UP)
    yield row("get_base_acceleration", lambda: (0.0,) * 3)
    yield row("set_safety_mode_transition_hardness", nothing, Parameter("type", whole(0, 1)))
    yield row("reset_revolution_counter", nothing, Parameter("qNear", JOINTS, None))


def _kinematics(controller: Controller) -> Iterable[Function]:
    near, tcp = Parameter("qnear", JOINTS, None), Parameter("tcp", POSE, None)
    finding = (near, Parameter("maxPositionError", NUMBER, 1e-10),
               Parameter("maxOrientationError", NUMBER, 1e-10), tcp)  # fmt: skip

    def forward(q: Vector6 | None, tcp: Pose | None) -> Pose:
        joints = controller.state.q if q is None else q
        X_FT = controller.X_FT if tcp is None else tcp.matrix
        return Pose.of(controller.robot.calibration.forward(joints) @ X_FT)

    def with_active_tcp(x: Pose, tcp: Pose | None) -> Pose:
        return x if tcp is None else Pose.of(x.matrix @ se3.inverse(tcp.matrix) @ controller.X_FT)

    def has_solution(x: Pose, *finding: Any) -> bool:
        return bool(reaching(controller, with_active_tcp(x, finding[-1])).size)

    def is_within_limits(x: Pose | Vector6, *_: object) -> bool:
        if isinstance(x, Pose):
            return has_solution(x, None)
        return bool(np.abs(x).max() <= ANGLE_LIMIT)

    def solve(x: Pose, qnear: Vector6 | None, *finding: Any) -> tuple[float, ...]:
        return tuple(inverse(controller, with_active_tcp(x, finding[-1]), qnear).tolist())

    yield row("get_forward_kin", forward, Parameter("q", JOINTS, None), tcp, costly=True)
    yield row("get_inverse_kin", solve, Parameter("x", POSE), *finding, costly=True)
    pose, position = Parameter("pose", POSE), Parameter("position", PLACE)
    yield row("get_inverse_kin_has_solution", has_solution, pose, *finding, costly=True)
    yield row("is_within_safety_limits", is_within_limits, position,
              Parameter("qNear", JOINTS, None), costly=True)  # fmt: skip
