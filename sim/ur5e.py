"""The UR5e from its published numbers.

Kinematics, masses and centres of mass: Universal Robots, "DH parameters for calculations of kinematics
and dynamics". Inertias of upper arm and forearm: Universal_Robots_ROS2_Description,
`config/ur5e/physical_parameters.yaml`; the other links count as solid cylinders of their mass and size.
Torque and speed limits: the same repository, `joint_limits.yaml`.

Servo gains, armature and friction are not published: they are chosen so that the simulated arm is as
stiff as one that repeats within .03 mm and follows a 25 mm/s path within .3 mm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from sim.describe import Element, add_collision, add_visual, placed
from sim.ur5e_shapes import MATERIALS, base_shapes, link_capsules, link_shapes

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One joint and the link it moves; DH frame i is fixed to link i."""

    a: float
    """DH link length [m]."""
    d: float
    """DH link offset [m]."""
    alpha: float
    """DH link twist [rad]."""
    mass: float
    """Mass of the link [kg]."""
    centre: Vector
    """Centre of mass in the link's DH frame [m]."""
    inertia: Vector
    """Principal moments about the centre of mass, along the DH frame's axes [kg m^2]."""
    torque: float
    """Largest torque [N m]."""
    stiffness: float
    """Position gain of the servo [N m/rad]."""
    damping: float
    """Velocity gain of the servo [N m s/rad]."""
    armature: float
    """Rotor inertia seen behind the gear [kg m^2]."""
    friction: float
    """Dry friction left over after the drive's own compensation [N m]."""


def _cylinder(mass: float, radius: float, length: float) -> Vector:
    """Moments of a solid cylinder along z [kg m^2]."""
    across = mass * (3 * radius**2 + length**2) / 12
    return (across, across, mass * radius**2 / 2)


SPEED_LIMIT = np.deg2rad(180.0)
"""Largest speed of every joint [rad/s]."""
ANGLE_LIMIT = np.deg2rad(360.0)
"""Largest angle of every joint, either way [rad]."""
BEARING_DAMPING = 1.0
"""Viscous friction of every joint [N m s/rad]."""

JOINTS = (
    Joint(
        a=0.0, d=0.1625, alpha=np.pi / 2, mass=3.761, centre=(0.0, -0.02561, 0.00193),
        inertia=_cylinder(3.761, 0.06, 0.15), torque=150.0,
        stiffness=12000.0, damping=500.0, armature=0.5, friction=1.0,
    ),
    Joint(
        a=-0.425, d=0.0, alpha=0.0, mass=8.058, centre=(0.2125, 0.0, 0.11336),
        inertia=(0.0151, 0.3339, 0.3325), torque=150.0,
        stiffness=12000.0, damping=500.0, armature=0.5, friction=1.0,
    ),
    Joint(
        a=-0.3922, d=0.0, alpha=0.0, mass=2.846, centre=(0.15, 0.0, 0.0265),
        inertia=(0.0040, 0.0788, 0.0785), torque=150.0,
        stiffness=8000.0, damping=300.0, armature=0.3, friction=0.8,
    ),
    Joint(
        a=0.0, d=0.1333, alpha=np.pi / 2, mass=1.37, centre=(0.0, -0.0018, 0.01634),
        inertia=_cylinder(1.37, 0.045, 0.11), torque=28.0,
        stiffness=2500.0, damping=60.0, armature=0.08, friction=0.2,
    ),
    Joint(
        a=0.0, d=0.0997, alpha=-np.pi / 2, mass=1.3, centre=(0.0, 0.0018, 0.01634),
        inertia=_cylinder(1.3, 0.045, 0.11), torque=28.0,
        stiffness=2500.0, damping=60.0, armature=0.08, friction=0.2,
    ),
    Joint(
        a=0.0, d=0.0996, alpha=0.0, mass=0.365, centre=(0.0, 0.0, -0.001159),
        inertia=_cylinder(0.365, 0.0375, 0.046), torque=28.0,
        stiffness=1200.0, damping=30.0, armature=0.08, friction=0.2,
    ),
)  # fmt: skip


def joint_names() -> list[str]:
    """Names of the six joints in a compiled model, base first."""
    return [f"joint{i}" for i in range(1, len(JOINTS) + 1)]


def link_pose(joint: Joint) -> Float[np.ndarray, "4 4"]:
    """The link's DH frame in the frame that turns with the joint: along z by d, along x by a, about x by alpha."""
    return se3.from_rotation_vector(np.array([joint.alpha, 0, 0]), np.array([joint.a, 0, joint.d]))


def add_arm(root: Element) -> Element:
    """Add the arm on the world's origin, with its servos.

    Returns:
        The body of the tool flange, whose frame is F.
    """
    for name, look in MATERIALS.items():
        root.asset.add("material", name=name, rgba=look.rgba, specular=look.shine, shininess=look.shine)
    body = root.worldbody.add("body", name="base")
    _add_shapes(body, "base", base_shapes())
    X_parent = np.eye(4)
    for number, joint in enumerate(JOINTS, start=1):
        body = body.add("body", name=f"link{number}", gravcomp=1.0, **placed(X_parent))
        _add_link(body, number, joint)
        _add_servo(root, number, joint)
        X_parent = link_pose(joint)
    return body.add("body", name="flange", gravcomp=1.0, **placed(X_parent))


def _add_link(body: Element, number: int, joint: Joint) -> None:
    X_link = link_pose(joint)
    X_centre = X_link @ se3.pose(np.eye(3), np.array(joint.centre))
    body.add("inertial", mass=joint.mass, diaginertia=joint.inertia, **placed(X_centre))
    body.add(
        "joint", name=f"joint{number}", axis=(0.0, 0.0, 1.0), range=(-ANGLE_LIMIT, ANGLE_LIMIT),
        armature=joint.armature, damping=BEARING_DAMPING, frictionloss=joint.friction,
        actuatorfrcrange=(-joint.torque, joint.torque),
    )  # fmt: skip
    _add_shapes(body, f"link{number}", link_shapes(number))
    for k, (start, end, radius) in enumerate(link_capsules(number)):
        add_collision(body, f"link{number}_hull{k}", of_arm=True, type="capsule", fromto=(*start, *end), size=(radius,))


def _add_shapes(body: Element, name: str, shapes: dict) -> None:
    for material, mesh in shapes.items():
        add_visual(body, f"{name}_{material}", mesh, material)


def _add_servo(root: Element, number: int, joint: Joint) -> None:
    """Position and velocity actuators in a pair: the second feeds the target's speed forward."""
    root.actuator.add("position", name=f"position{number}", joint=f"joint{number}", kp=joint.stiffness)
    root.actuator.add("velocity", name=f"velocity{number}", joint=f"joint{number}", kv=joint.damping)
