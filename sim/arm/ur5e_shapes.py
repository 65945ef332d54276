"""What the UR5e's links look like: turned housings, conical tubes, blue lids and dark seals.

Each link is drawn in the frame that turns with its joint: z along the joint's axis, origin on the
DH frame before it. Measures are read off the arm's outline; they carry no mechanics.
"""

import trimesh

from breastscan.geometry.arm_hulls import (
    FOREARM_LENGTH,
    FOREARM_OFFSET,
    LARGE,
    MEDIUM,
    SHOULDER_HEIGHT,
    SMALL,
    UPPER_ARM_LENGTH,
    UPPER_ARM_OFFSET,
    WRIST_1,
    WRIST_2,
)
from breastscan.geometry.kinematics import DH_D
from sim.room.shapes import (
    MINUS_X,
    MINUS_Y,
    MINUS_Z,
    Point,
    Y,
    Z,
    along,
    barrel,
    cap,
    joined,
    lathe,
    tube,
)

Shapes = dict[str, trimesh.Trimesh]


MATERIALS = {
    "shell": ((0.80, 0.81, 0.82, 1.0), 0.35),
    "lid": ((0.42, 0.66, 0.83, 1.0), 0.30),
    "seal": ((0.13, 0.135, 0.145, 1.0), 0.20),
    "metal": ((0.52, 0.53, 0.55, 1.0), 0.55),
}

WRIST_3 = float(DH_D[5])
SEAL = 0.006
"""Width of the dark gap between two links [m]."""
GROOVE = 0.002
"""How far a seal lies below the housings beside it [m]."""


def base_shapes() -> Shapes:
    """The foot that is bolted to the table."""
    foot = lathe(
        [(0.0, 0.0), (0.0755, 0.0), (0.0755, 0.010), (0.0725, 0.013), (0.0725, 0.016), (0.0, 0.016)]
    )
    column = along(barrel(0.0715, 0.076), Z, (0.0, 0.0, 0.014))
    connector = along(barrel(0.016, 0.022, 0.002), MINUS_X, (-0.062, 0.0, 0.040))
    return {
        "metal": foot,
        "shell": column,
        "seal": joined(_seal(0.0715, (0.0, 0.0, 0.089), Z), connector),
    }


def link_shapes(number: int) -> Shapes:
    """Shapes of link 1 to 6 by material."""
    return (_shoulder, _upper_arm, _forearm, _wrist_1, _wrist_2, _wrist_3)[number - 1]()


def _seal(radius: float, start: Point, axis: Point) -> trimesh.Trimesh:
    return along(barrel(radius - GROOVE, SEAL, 0.0005), axis, start)


def _lid(radius: float, height: float, start: Point, axis: Point) -> trimesh.Trimesh:
    return along(cap(radius, height), axis, start)


def _shoulder() -> Shapes:
    h = SHOULDER_HEIGHT
    column = along(barrel(0.0635, h - 0.095 + 0.01, 0.008), Z, (0.0, 0.0, 0.095))
    motor = along(barrel(LARGE, 0.066 + 0.050, 0.008), MINUS_Y, (0.0, 0.050, h))
    return {
        "shell": joined(column, motor),
        "lid": _lid(LARGE - 0.002, 0.020, (0.0, 0.049, h), Y),
        "seal": _seal(LARGE, (0.0, -0.066, h), MINUS_Y),
    }


def _upper_arm() -> Shapes:
    z, elbow = UPPER_ARM_OFFSET, -UPPER_ARM_LENGTH
    near = along(barrel(LARGE, 0.118, 0.008), Z, (0.0, 0.0, 0.072))
    far = along(barrel(MEDIUM + 0.003, 0.118, 0.008), Z, (elbow, 0.0, 0.072))
    arm = along(tube(0.0555, 0.0490, UPPER_ARM_LENGTH), MINUS_X, (0.0, 0.0, z - 0.004))
    collars = (
        along(tube(0.0570, 0.0564, 0.010), MINUS_X, (-0.070, 0.0, z - 0.004)),
        along(tube(0.0520, 0.0516, 0.010), MINUS_X, (elbow + 0.072, 0.0, z - 0.004)),
    )
    lids = (
        _lid(LARGE - 0.002, 0.020, (0.0, 0.0, 0.189), Z),
        _lid(MEDIUM + 0.001, 0.018, (elbow, 0.0, 0.189), Z),
    )
    return {
        "shell": joined(near, far, arm),
        "lid": joined(*lids),
        "seal": joined(_seal(MEDIUM + 0.003, (elbow, 0.0, 0.066), Z), *collars),
    }


def _forearm() -> Shapes:
    z, wrist = FOREARM_OFFSET, -FOREARM_LENGTH
    near = along(barrel(MEDIUM + 0.003, 0.116, 0.008), Z, (0.0, 0.0, -0.050))
    far = along(barrel(SMALL, 0.098, 0.007), Z, (wrist, 0.0, -0.050))
    arm = along(tube(0.0475, 0.0385, FOREARM_LENGTH), MINUS_X, (0.0, 0.0, z))
    collars = (
        along(tube(0.0478, 0.0475, 0.010), MINUS_X, (-0.068, 0.0, z)),
        along(tube(0.0415, 0.0412, 0.010), MINUS_X, (wrist + 0.056, 0.0, z)),
    )
    lids = (
        _lid(MEDIUM + 0.001, 0.018, (0.0, 0.0, -0.049), MINUS_Z),
        _lid(SMALL - 0.0015, 0.016, (wrist, 0.0, -0.049), MINUS_Z),
    )
    return {
        "shell": joined(near, far, arm),
        "lid": joined(*lids),
        "seal": joined(_seal(SMALL, (wrist, 0.0, 0.048), Z), *collars),
    }


def _wrist(length: float, side: Point) -> Shapes:
    """A wrist joint: a housing along its own axis, a lid on its end, and the seat of the next
    joint on one side.
    """
    seat = tuple(0.047 * component for component in side)
    body = along(barrel(SMALL, length + 0.042 - 0.054, 0.007), Z, (0.0, 0.0, 0.054))
    neck = along(barrel(SMALL - 0.001, 0.047, 0.004), side, (0.0, 0.0, length))
    return {
        "shell": joined(body, neck),
        "lid": _lid(SMALL - 0.0015, 0.016, (0.0, 0.0, length + 0.041), Z),
        "seal": _seal(SMALL, (seat[0], seat[1], length), side),
    }


def _wrist_1() -> Shapes:
    return _wrist(WRIST_1, MINUS_Y)


def _wrist_2() -> Shapes:
    return _wrist(WRIST_2, Y)


def _wrist_3() -> Shapes:
    body = along(barrel(0.0375, WRIST_3 - 0.053 - 0.008, 0.003), Z, (0.0, 0.0, 0.053))
    plate = along(barrel(0.0315, 0.008, 0.001), Z, (0.0, 0.0, WRIST_3 - 0.008))
    return {"shell": body, "metal": plate}
