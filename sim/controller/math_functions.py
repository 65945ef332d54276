"""The functions of numbers and poses [UR-script, "Module urmath"]."""

import math
import random
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from sim.controller.urscript.signature import (
    ANYTHING,
    INTEGER,
    JOINTS,
    LIST,
    NUMBER,
    POSE,
    VECTOR,
    Function,
    Parameter,
    row,
)
from sim.controller.urscript.values import (
    LARGEST_INTEGER,
    Pose,
    ScriptError,
    Value,
    is_number,
    truth,
)

BITS = 32
"""Of an integer."""
Vector3 = Float[np.ndarray, "3"]
Vector6 = Float[np.ndarray, "6"]


def math_functions() -> Iterable[Function]:
    """Their rows."""
    yield from _numbers()
    yield from _poses()


def _numbers() -> Iterable[Function]:
    x, y = Parameter("x", NUMBER), Parameter("y", NUMBER)
    angles = math.sin, math.cos, math.tan, math.asin, math.acos, math.atan
    for compute in (*angles, math.sqrt, math.floor, math.ceil):
        yield row(compute.__name__, compute, x)
    yield row("d2r", math.radians, x)
    yield row("r2d", math.degrees, x)
    yield row("atan2", math.atan2, x, y)
    yield row("pow", math.pow, Parameter("base", NUMBER), Parameter("exponent", NUMBER))
    yield row("log", lambda b, f: math.log(f, b), Parameter("b", NUMBER), Parameter("f", NUMBER))
    yield row("random", random.Random(0).random)
    yield row("norm", _norm, Parameter("a", ANYTHING), costly=True)
    yield row("normalize", _normalized, Parameter("v", LIST), costly=True)
    bits = Parameter("l", LIST)
    yield row("binary_list_to_integer", _from_bits, bits, costly=True)
    yield row("integer_to_binary_list", _to_bits, Parameter("x", INTEGER), costly=True)


def _norm(value: Value) -> float:
    numbers = value if isinstance(value, tuple) else (value,)
    if not all(map(is_number, numbers)):
        raise ScriptError("norm: a is a number or a list of numbers", value)
    return math.hypot(*numbers)


def _normalized(values: tuple) -> tuple:
    length = _norm(values)
    if not length > 0:
        raise ScriptError("normalize: a list of zeros has no direction", values)
    return tuple(value / length for value in values)


def _to_bits(number: int) -> tuple[bool, ...]:
    return tuple(bool(number >> i & 1) for i in range(BITS))


def _from_bits(bits: tuple) -> int:
    number = sum(1 << i for i, bit in enumerate(bits[:BITS]) if truth(bit))
    return number if number <= LARGEST_INTEGER else number - 2**BITS


def _poses() -> Iterable[Function]:
    def added(a: Pose, b: Pose, sign: float) -> Pose:
        """Positions and rotations apart, as the script language adds poses."""
        A, B = a.matrix, b.matrix
        R = B[:3, :3] if sign > 0 else B[:3, :3].T
        return Pose.of(se3.pose(A[:3, :3] @ R, A[:3, 3] + sign * B[:3, 3]))

    first, second = Parameter("p_1", POSE), Parameter("p_2", POSE)
    start, end = Parameter("p_from", POSE), Parameter("p_to", POSE)
    step, wrench = Parameter("p_from_to", POSE), Parameter("w_from", JOINTS)
    rows: dict[str, tuple[Callable[..., Value], tuple[Parameter, ...]]] = {
        "pose_trans": (lambda a, b: Pose.of(a.matrix @ b.matrix), (start, step)),
        "pose_inv": (lambda a: Pose.of(se3.inverse(a.matrix)), (start,)),
        "pose_add": (lambda a, b: added(a, b, 1.0), (first, second)),
        "pose_sub": (lambda a, b: added(a, b, -1.0), (end, start)),
        "point_dist": (lambda a, b: math.dist(a[:3], b[:3]), (start, end)),
        "pose_dist": (_pose_distance, (start, end)),
        "interpolate_pose": (_between, (start, end, Parameter("alpha", NUMBER))),
        "rotvec2rpy": (_to_rpy, (Parameter("rotation_vector", VECTOR),)),
        "rpy2rotvec": (_from_rpy, (Parameter("rpy_vector", VECTOR),)),
        "wrench_trans": (_moved_wrench, (Parameter("T_from_to", POSE), wrench)),
    }
    for name, (compute, parameters) in rows.items():
        yield row(name, compute, *parameters, costly=True)


def _pose_distance(a: Pose, b: Pose) -> float:
    """Metres and radians together, as one vector; assumed."""
    return float(np.linalg.norm(se3.pose_vector(se3.inverse(a.matrix) @ b.matrix)))


def _between(a: Pose, b: Pose, alpha: float) -> Pose:
    A, B = a.matrix, b.matrix
    turn = alpha * se3.rotation_vector(se3.inverse(A) @ B)
    X = A @ se3.from_rotation_vector(turn, np.zeros(3))
    X[:3, 3] = A[:3, 3] + alpha * (B[:3, 3] - A[:3, 3])
    return Pose.of(X)


def _to_rpy(rotation_vector: Vector3) -> tuple[float, ...]:
    return tuple(Rotation.from_rotvec(rotation_vector).as_euler("xyz").tolist())


def _from_rpy(rpy: Vector3) -> tuple[float, ...]:
    return tuple(Rotation.from_euler("xyz", rpy).as_rotvec().tolist())


def _moved_wrench(T: Pose, wrench: Vector6) -> tuple[float, ...]:
    """The same forces about another point and in other axes."""
    X = T.matrix
    moment = wrench[3:] - np.cross(X[:3, 3], wrench[:3])
    return tuple(np.concatenate([wrench[:3] @ X[:3, :3], moment @ X[:3, :3]]).tolist())
