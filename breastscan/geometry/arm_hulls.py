"""The hulls of the UR5e's links: capsules around its housings and tubes.

Each lies in the frame that rotates with its joint: z along the joint's axis, origin on the DH frame
before it. Offsets and radii are read off the arm's outline.
"""

import numpy as np

from breastscan.geometry import se3
from breastscan.geometry.hulls import Shape
from breastscan.geometry.kinematics import DH_A, DH_D

SHOULDER_HEIGHT, WRIST_1, WRIST_2 = (float(DH_D[k]) for k in (0, 3, 4))
UPPER_ARM_LENGTH, FOREARM_LENGTH = -float(DH_A[1]), -float(DH_A[2])
UPPER_ARM_OFFSET = 0.138
FOREARM_OFFSET = 0.007
"""How far the tubes lie beside the joints' planes [m]."""
LARGE = 0.060
MEDIUM = 0.054
SMALL = 0.0455
"""Radii of the three joint sizes [m]."""

Point = tuple[float, float, float]
Capsule = tuple[Point, Point, float]

LINK_CAPSULES: tuple[tuple[Capsule, ...], ...] = (
    (((0.0, 0.0, 0.13), (0.0, 0.0, SHOULDER_HEIGHT), 0.065),),
    (
        ((0.0, 0.0, UPPER_ARM_OFFSET), (-UPPER_ARM_LENGTH, 0.0, UPPER_ARM_OFFSET), LARGE),
        ((-UPPER_ARM_LENGTH, 0.0, 0.10), (-UPPER_ARM_LENGTH, 0.0, 0.16), LARGE),
    ),
    (((0.0, 0.0, FOREARM_OFFSET), (-FOREARM_LENGTH, 0.0, FOREARM_OFFSET), MEDIUM),),
    (((0.0, 0.0, 0.08), (0.0, 0.0, WRIST_1 + 0.01), SMALL),),
    (((0.0, 0.0, 0.07), (0.0, 0.0, WRIST_2 + 0.01), SMALL),),
    (((0.0, 0.0, 0.055), (0.0, 0.0, 0.065), 0.034),),
)
"""Of links 1 to 6: start and end of each capsule's axis, and its radius [m]."""


def link_hulls(number: int) -> list[Shape]:
    """The hulls of link 1 to 6, placed in the frame that rotates with its joint."""
    return [
        _capsule(f"link{number}_hull{k}", *capsule)
        for k, capsule in enumerate(LINK_CAPSULES[number - 1])
    ]


def _capsule(name: str, start: Point, end: Point, radius: float) -> Shape:
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    X = np.eye(4)
    X[:3, :3] = se3.axes_along(along / length).T
    X[:3, 3] = np.add(start, end) / 2.0
    return Shape(name=name, kind="capsule", size=(radius, length / 2.0), X=X)
