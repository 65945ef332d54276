"""The UR5e from its published numbers.

Masses and centres of mass: [UR-DH]. Inertia tensors: [UR-inertia]. Torque and speed limits:
[UR-limits]. Viscous friction of the joints, and the inertia of rotor and gear behind it:
[Clochiatti], at second hand; that inertia is known for the three large joints, and scaled to the
wrist's by torque to the power of 1.24. Where the axes lie comes from `breastscan.geometry`, for the
arm of the drawing or another.

Dry friction is not published: a real drive compensates most of it, and what is left here is chosen,
1 % of the torque.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.arm_hulls import LINK_CAPSULES
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.kinematics import DH_A, DH_ALPHA, DH_D
from breastscan.robot.ur.ur5e import ANGLE_LIMIT
from sim.arm.ur5e_shapes import MATERIALS, base_shapes, link_shapes
from sim.room.describe import Element, add_collision, add_materials, add_visual, placed

JOINT_END = ANGLE_LIMIT + np.deg2rad(15.0)
"""Where the joints end, beyond what a controller lets them reach [rad]; chosen."""
Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One joint and the link it moves; DH frame i is fixed to link i."""

    mass: float
    """Mass of the link [kg]."""
    centre: Vector
    """Centre of mass in the link's DH frame [m]."""
    inertia: tuple[float, float, float, float, float, float]
    """xx, yy, zz, xy, xz, yz about the centre of mass, along the DH frame's axes [kg m^2]."""
    torque: float
    """Largest torque [N m]."""
    armature: float
    """Inertia of rotor and gear, as the joint feels it [kg m^2]."""
    viscous: float
    """Friction per speed [N m s/rad]."""
    dry: float
    """Dry friction left over by the drive's compensation [N m]."""
    stiffness: float
    """Position gain of the drive [N m/rad]."""
    damping: float
    """Velocity gain of the drive [N m s/rad]."""


JOINTS = (
    Joint(
        mass=3.761, centre=(0.0, -0.02561, 0.00193),
        inertia=(0.00700210, 0.00648091, 0.00657286, 0.00000073, -0.00001053, 0.00049994),
        torque=150.0, armature=1.7, viscous=4.75, dry=1.5, stiffness=12000.0, damping=500.0,
    ),
    Joint(
        mass=8.058, centre=(0.2125, 0.0, 0.11336),
        inertia=(0.01505885, 0.33388086, 0.33247207, -0.00005400, 0.00000563, -0.00000181),
        torque=150.0, armature=1.7, viscous=10.73, dry=1.5, stiffness=12000.0, damping=500.0,
    ),
    Joint(
        mass=2.846, centre=(0.15, 0.0, 0.0265),
        inertia=(0.00399632, 0.07879254, 0.07848510, -0.00001365, 0.00137272, -0.00000660),
        torque=150.0, armature=1.7, viscous=3.82, dry=1.5, stiffness=8000.0, damping=300.0,
    ),
    Joint(
        mass=1.37, centre=(0.0, -0.0018, 0.01634),
        inertia=(0.00165491, 0.00135962, 0.00126279, -0.00000282, -0.00000438, 0.00010157),
        torque=28.0, armature=0.2, viscous=2.95, dry=0.28, stiffness=2500.0, damping=60.0,
    ),
    Joint(
        mass=1.3, centre=(0.0, 0.0018, 0.01634),
        inertia=(0.00135617, 0.00127827, 0.00096614, -0.00000274, 0.00000444, -0.00005048),
        torque=28.0, armature=0.2, viscous=1.14, dry=0.28, stiffness=2500.0, damping=60.0,
    ),
    Joint(
        mass=0.365, centre=(0.0, 0.0, -0.001159),
        inertia=(0.00018694, 0.00018908, 0.00025756, 0.00000006, -0.00000017, -0.00000092),
        torque=28.0, armature=0.2, viscous=1.88, dry=0.28, stiffness=2500.0, damping=60.0,
    ),
)  # fmt: skip


def joint_names() -> list[str]:
    """Names of the six joints in a compiled model, base first."""
    return [f"joint{i}" for i in range(1, len(JOINTS) + 1)]


def add_arm(root: Element, arm: KinematicCalibration | None = None) -> Element:
    """Add the arm on the world's origin, with its drives.

    Args:
        root: The description.
        arm: Where its axes and its flange lie; None for the arm of the drawing. What a link weighs
            stays in its place beside the joint's axis, and so does what is seen of it.

    Returns:
        The body of the tool flange, whose frame is F.
    """
    arm = arm or KinematicCalibration.nominal()
    add_materials(root, MATERIALS)
    body = root.worldbody.add("body", name="base")
    _add_shapes(body, "base", base_shapes())
    for number, (joint, X_joint) in enumerate(zip(JOINTS, arm.X_joints, strict=True), start=1):
        body = body.add("body", name=f"link{number}", gravcomp=1.0, **placed(X_joint))
        _add_link(body, number, joint)
        _add_drive(root, number, joint)
    return body.add("body", name="flange", gravcomp=1.0, **placed(arm.X_6F))


def link_pose(number: int) -> Float[np.ndarray, "4 4"]:
    """DH frame 1 to 6 in the frame that turns with its joint: along z by d, along x by a, about
    x by alpha.
    """
    twist = DH_ALPHA[number - 1]
    length = DH_A[number - 1]
    offset = DH_D[number - 1]
    return se3.from_rotation_vector(np.array([twist, 0.0, 0.0]), np.array([length, 0.0, offset]))


def _add_link(body: Element, number: int, joint: Joint) -> None:
    X_link = link_pose(number)
    inertia = X_link[:3, :3] @ _tensor(joint) @ X_link[:3, :3].T
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    body.add(
        "inertial", mass=joint.mass, pos=se3.transform(X_link, np.array(joint.centre)),
        fullinertia=inertia[rows, columns],
    )  # fmt: skip
    body.add(
        "joint", name=f"joint{number}", axis=(0.0, 0.0, 1.0), range=(-JOINT_END, JOINT_END),
        armature=joint.armature, damping=joint.viscous, frictionloss=joint.dry,
        actuatorfrcrange=(-joint.torque, joint.torque), actuatorgravcomp=True,
    )  # fmt: skip
    _add_shapes(body, f"link{number}", link_shapes(number))
    for k, (start, end, radius) in enumerate(LINK_CAPSULES[number - 1]):
        add_collision(
            body,
            f"link{number}_hull{k}",
            of_arm=True,
            type="capsule",
            fromto=(*start, *end),
            size=(radius,),
        )


def _tensor(joint: Joint) -> Float[np.ndarray, "3 3"]:
    xx, yy, zz, xy, xz, yz = joint.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _add_shapes(body: Element, name: str, shapes: dict) -> None:
    for material, mesh in shapes.items():
        add_visual(body, f"{name}_{material}", mesh, material)


def _add_drive(root: Element, number: int, joint: Joint) -> None:
    """Position and velocity actuators in a pair, which `sim.arm.drives` commands."""
    root.actuator.add(
        "position", name=f"position{number}", joint=f"joint{number}", kp=joint.stiffness
    )
    root.actuator.add(
        "velocity", name=f"velocity{number}", joint=f"joint{number}", kv=joint.damping
    )
