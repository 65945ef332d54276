"""What the arm carries: wrist sensor, mount and convex ultrasound probe.

The mount rotates the probe out of the flange's axis, which lets the arm reach all around the breast
with less joint motion than a probe straight on the flange. Masses are those of a six-axis sensor of
the Axia80 class, an aluminium bracket and a hand-held convex probe with a short length of its
cable.
"""

import numpy as np
import trimesh
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.robot.payload import Payload
from sim.room.describe import Element, add_collision, add_materials, add_visual, placed
from sim.room.shapes import MINUS_Y, Z, along, barrel, hose, joined, loft, moved, superellipse
from sim.wrist.probe_face import ProbeFace

SENSOR_HEIGHT, SENSOR_RADIUS = 0.036, 0.041
"""The wrist sensor, from the flange to its tool side [m]."""
ELBOW_HEIGHT = 0.060
"""Where the mount's bend lies on the flange's axis [m]."""
REACH = 0.140
"""From the bend to the centre of the probe's face [m]."""
SENSOR_MASS = 0.26
MOUNT_MASS = 0.13
PROBE_MASS = 0.26
"""[kg]"""
MATERIALS = {
    "probe_shell": ((0.90, 0.90, 0.87, 1.0), 0.30),
    "lens": ((0.10, 0.105, 0.12, 1.0), 0.25),
    "cable": ((0.20, 0.205, 0.22, 1.0), 0.10),
    "accent": ((0.25, 0.50, 0.62, 1.0), 0.25),
}
CLAMP = -0.098
"""Where along the probe its handle enters the mount's clamp, from the face [m]."""
LENS_BACK = -0.014
"""How far the dark nose reaches back from the face [m]."""
HANDLE = (
    (-0.010, 0.0300, 0.0095, 4.0),
    (-0.020, 0.0305, 0.0110, 4.0),
    (-0.034, 0.0285, 0.0130, 3.4),
    (-0.048, 0.0235, 0.0140, 3.0),
    (-0.062, 0.0190, 0.0145, 2.6),
    (-0.080, 0.0172, 0.0145, 2.4),
    (-0.100, 0.0170, 0.0140, 2.4),
    (-0.122, 0.0155, 0.0130, 2.2),
    (-0.130, 0.0110, 0.0100, 2.0),
)
"""Cross-sections of the handle: place along z_P [m], half width [m], half thickness [m], roundness
[-]."""


def tip_pose(mount_angle: float) -> Float[np.ndarray, "4 4"]:
    """`X_FP`: up to the bend, rotated about y by the mount's angle [rad], and on to the face."""
    along_flange = se3.pose(np.eye(3), np.array([0, 0, ELBOW_HEIGHT]))
    bend = se3.from_rotation_vector(np.array([0, mount_angle, 0]), np.zeros(3))
    along_probe = se3.pose(np.eye(3), np.array([0, 0, REACH]))
    return along_flange @ bend @ along_probe


def payload(mount_angle: float) -> Payload:
    """Mass and centre of mount and probe together, as a user would enter them."""
    X_FP = tip_pose(mount_angle)
    probe_F = se3.transform(X_FP, np.array([0, 0, -0.075]))
    mount_F = np.array([0, 0, ELBOW_HEIGHT])
    mass = MOUNT_MASS + PROBE_MASS
    return Payload(mass=mass, centre_F=(MOUNT_MASS * mount_F + PROBE_MASS * probe_F) / mass)


def add_tool(flange: Element, mount_angle: float, face: ProbeFace) -> None:
    """Hang sensor, mount and probe on the flange; sites `wrist` and `tip` and two sensors go
    with them.
    """
    root = flange.root
    add_materials(root, MATERIALS)
    _add_sensor_housing(flange)
    tool = flange.add("body", name="tool", gravcomp=1)
    _add_inertia(tool, mount_angle)
    _add_mount(tool, mount_angle)
    _add_probe(tool, tip_pose(mount_angle), face)
    tool.add("site", name="wrist", pos=(0.0, 0.0, SENSOR_HEIGHT))
    tool.add("site", name="tip", **placed(tip_pose(mount_angle)))
    root.sensor.add("force", name="wrist_force", site="wrist")
    root.sensor.add("torque", name="wrist_torque", site="wrist")


def _add_inertia(tool: Element, mount_angle: float) -> None:
    """Mount and probe as one body: a rod along the probe about their common centre."""
    load = payload(mount_angle)
    across, around = load.mass * REACH**2 / 12, load.mass * 0.02**2 / 2
    X_FM = tip_pose(mount_angle).copy()
    X_FM[:3, 3] = load.centre_F
    tool.add("inertial", mass=load.mass, diaginertia=(across, across, around), **placed(X_FM))


def _add_sensor_housing(flange: Element) -> None:
    radius, height = SENSOR_RADIUS, SENSOR_HEIGHT
    across = SENSOR_MASS * (3 * radius**2 + height**2) / 12
    inertia = (across, across, SENSOR_MASS * radius**2 / 2)
    flange.add("inertial", mass=SENSOR_MASS, pos=(0.0, 0.0, height / 2), diaginertia=inertia)
    lower = along(barrel(radius, 0.019, 0.002), Z, (0.0, 0.0, 0.0))
    upper = along(barrel(radius, 0.014, 0.002), Z, (0.0, 0.0, 0.022))
    gap = along(barrel(radius - 0.002, 0.006, 0.0005), Z, (0.0, 0.0, 0.018))
    plug = along(barrel(0.007, 0.014, 0.001), MINUS_Y, (0.0, -radius + 0.002, 0.010))
    add_visual(flange, "sensor_housing", joined(lower, upper), "seal")
    add_visual(flange, "sensor_gap", joined(gap, plug), "metal")
    add_collision(
        flange,
        "sensor_hull",
        of_arm=True,
        type="cylinder",
        size=(radius, height / 2),
        pos=(0, 0, height / 2),
    )


def _add_mount(tool: Element, mount_angle: float) -> None:
    """A plate on the sensor, an arm through the bend, and a clamp around the handle."""
    X_FP = tip_pose(mount_angle)
    plate = along(barrel(0.034, 0.008, 0.0015), Z, (0.0, 0.0, SENSOR_HEIGHT))
    neck = along(barrel(0.024, 0.004, 0.001), Z, (0.0, 0.0, SENSOR_HEIGHT + 0.006))
    clamp = moved(_prism(0.0235, 0.0205, CLAMP - 0.024, CLAMP), X_FP)
    arm = trimesh.convex.convex_hull(
        joined(neck, moved(_prism(0.021, 0.018, CLAMP - 0.030, CLAMP - 0.020), X_FP))
    )
    add_visual(tool, "mount", joined(plate, arm, clamp), "metal")


def _prism(half_x: float, half_y: float, start: float, end: float) -> trimesh.Trimesh:
    """A straight block along z with soft corners."""
    outline = superellipse(half_x, half_y, 4.0)
    edge = 0.0015
    levels = (
        (start, 1 - edge / half_x),
        (start + edge, 1.0),
        (end - edge, 1.0),
        (end, 1 - edge / half_x),
    )
    return loft(
        np.array([np.column_stack([s * outline, np.full(len(outline), z)]) for z, s in levels])
    )


def _add_probe(tool: Element, X_FP: Float[np.ndarray, "4 4"], face: ProbeFace) -> None:
    add_visual(tool, "probe_handle", moved(_handle(), X_FP), "probe_shell")
    add_visual(tool, "probe_lens", moved(lens(face), X_FP), "lens")
    add_visual(
        tool,
        "probe_ring",
        moved(_prism(0.0178, 0.0152, CLAMP + 0.010, CLAMP + 0.014), X_FP),
        "accent",
    )
    add_visual(tool, "probe_cable", moved(_cable(), X_FP), "cable")
    add_collision(
        tool,
        "probe_hull",
        of_arm=True,
        type="box",
        size=(0.028, 0.013, 0.055),
        **placed(X_FP @ se3.pose(np.eye(3), np.array([0, 0, -0.065]))),
    )


def _handle() -> trimesh.Trimesh:
    """The white shell, widening towards the face."""
    places, *sizes = np.array(HANDLE).T
    fine = np.linspace(places[-1], places[0], 40)
    half_x, half_y, roundness = (np.interp(fine, places[::-1], size[::-1]) for size in sizes)
    outlines = [superellipse(*section) for section in zip(half_x, half_y, roundness, strict=True)]
    return loft(
        np.array(
            [np.column_stack([o, np.full(len(o), z)]) for o, z in zip(outlines, fine, strict=True)]
        )
    )


def lens(face: ProbeFace) -> trimesh.Trimesh:
    """The dark nose: the exact contact face, closed behind."""
    inner_radius = face.radius - face.edge_radius
    half_angle = (face.arc / 2 - face.edge_radius) / face.radius
    half_width = face.elevation / 2 - face.edge_radius
    angle = np.linspace(-half_angle, half_angle, 41)
    arc = np.stack(
        [inner_radius * np.sin(angle), inner_radius * np.cos(angle) - face.radius], axis=1
    )
    edge = trimesh.creation.uv_sphere(radius=face.edge_radius, count=(12, 16)).vertices
    front = [edge + np.array([x, y, z]) for x, z in arc for y in (-half_width, half_width)]
    half_x, half_y = 0.029, face.elevation / 2 - 0.0005
    back = [[x, y, LENS_BACK] for x in (-half_x, half_x) for y in (-half_y, half_y)]
    return trimesh.convex.convex_hull(np.vstack([*front, back]))


def _cable() -> trimesh.Trimesh:
    """A stub of the cable: out of the clamp's side, then back along the probe."""
    bend_angle = np.linspace(0, np.pi / 2, 14)
    bend_radius = 0.030
    y = 0.012 + bend_radius * np.sin(bend_angle)
    z = CLAMP - 0.012 - bend_radius * (1 - np.cos(bend_angle))
    bend = np.column_stack([np.zeros_like(bend_angle), y, z])
    straight = bend[-1] + np.outer(np.linspace(0.004, 0.03, 6), [0, 0, -1])
    return hose(np.vstack([bend, straight]), 0.0042)
