"""The surroundings: floor, table, camera stand and lights."""

import numpy as np
import trimesh
from jaxtyping import Float

from breastscan.geometry import se3
from sim.room.describe import (
    Element,
    add_collision,
    add_materials,
    add_visual,
)
from sim.room.shapes import Z, along, barrel, joined, loft, moved, superellipse

TABLE_X, TABLE_Y = (-0.30, 1.12), (-0.52, 0.52)
"""Extent of the table top in B [m]."""
TABLE_THICKNESS, TABLE_HEIGHT = 0.035, 0.76
"""[m]"""
STANDING_ROOM_X = (0.30, 0.78)
STANDING_ROOM_Y = (-0.27, 0.27)
"""Where the centre of the chest plate may stand without touching the robot, the stand or the
table's edge, in B [m]."""
POST_X, POST_RADIUS = 1.03, 0.022
"""The camera stand's post, behind the phantom and outside both cameras' view [m]."""
LIT_CENTRE, LIT_RADIUS = (0.40, 0.0, 0.20), 1.1
"""What casts shadows: the shadow map covers a square of this half side about this point in B
[m]."""
KEY_DISTANCE = 2.0
"""Distance of the key light from that point [m]."""
BOOM_CLEARANCE = 0.075
"""Height of the boom's axis above the cameras' optical centres [m]."""
COLOURS = {
    "table_top": ((0.86, 0.87, 0.87, 1.0), 0.06),
    "table_edge": ((0.33, 0.35, 0.38, 1.0), 0.10),
    "rail": ((0.60, 0.62, 0.64, 1.0), 0.35),
    "camera_body": ((0.17, 0.18, 0.20, 1.0), 0.25),
    "camera_glass": ((0.05, 0.06, 0.10, 1.0), 0.90),
}
FINE_NUMBERS = {
    "cg.exposure": -0.8,
    "cg.contrast": 1.12,
    "cg.temperature": -0.07,
    "cg.saturation": 1.4,
    "fallback.environment_light_intensity": 10000.0,
    "fallback.scene_light_intensity": 70000.0,
}
FINE_WORDS = {"cg.tone_mapping": "filmic", "shadows.type": "pcss"}
"""Light and tone under the physically based renderer (`sim.cameras.filament`, Studio), by eye; the
classic one ignores them."""


def add_room(root: Element) -> None:
    """Floor, table, sky and lights."""
    add_materials(root, COLOURS)
    _add_lights(root)
    _add_fine_looks(root)
    _add_floor(root)
    _add_table(root.worldbody)


def add_stand(
    root: Element, X_BL: Float[np.ndarray, "4 4"], X_BR: Float[np.ndarray, "4 4"]
) -> None:
    """The two cameras at their poses, on a boom from a post behind the phantom."""
    stand = root.worldbody.add("body", name="stand")
    for side, X_BC in (("left", X_BL), ("right", X_BR)):
        add_visual(stand, f"{side}_housing", moved(_housing(), X_BC), "camera_body")
        add_visual(stand, f"{side}_glass", moved(_glass(), X_BC), "camera_glass")
    centre = (X_BL[:3, 3] + X_BR[:3, 3]) / 2
    _add_boom(stand, centre)


def _add_lights(root: Element) -> None:
    """A key light with shadow from beside the table, and two fills without."""
    direction = np.array([-0.40, 0.62, -0.85]) / np.linalg.norm([-0.40, 0.62, -0.85])
    root.worldbody.add(
        "light",
        name="key",
        type="directional",
        pos=np.array(LIT_CENTRE) - KEY_DISTANCE * direction,
        dir=direction,
        castshadow=True,
        diffuse=(0.54, 0.53, 0.51),
        specular=(0.25, 0.25, 0.25),
        ambient=(0.0, 0.0, 0.0),
    )
    for name, direction, level in (
        ("fill", (-0.5, -0.6, -0.8), 0.18),
        ("back", (0.8, 0.3, -0.5), 0.14),
    ):
        root.worldbody.add(
            "light",
            name=name,
            type="directional",
            pos=(0.0, 0.0, 2),
            dir=direction,
            castshadow=False,
            diffuse=(level, level, 1.06 * level),
            specular=(0.1, 0.1, 0.1),
            ambient=(0.0, 0.0, 0.0),
        )


def _add_fine_looks(root: Element) -> None:
    for name, number in FINE_NUMBERS.items():
        root.custom.add("numeric", name=f"filament.{name}", data=[number])
    for name, word in FINE_WORDS.items():
        root.custom.add("text", name=f"filament.{name}", data=word)


def _add_floor(root: Element) -> None:
    root.asset.add(
        "texture", name="sky", type="skybox", builtin="gradient",
        rgb1=(0.80, 0.84, 0.88), rgb2=(0.50, 0.55, 0.60), width=256, height=256,
    )  # fmt: skip
    tiles = root.asset.add(
        "texture",
        name="tiles",
        type="2d",
        builtin="flat",
        mark="edge",
        rgb1=(0.60, 0.63, 0.65),
        rgb2=(0.60, 0.63, 0.65),
        markrgb=(0.52, 0.55, 0.57),
        width=512,
        height=512,
    )
    root.asset.add(
        "material",
        name="tiles",
        texture=tiles,
        texrepeat=(2, 2),
        texuniform=True,
        specular=0,
        shininess=0,
    )
    root.worldbody.add(
        "geom",
        name="floor",
        type="plane",
        size=(6, 6, 0.1),
        pos=(0, 0, -TABLE_HEIGHT),
        material="tiles",
        contype=0,
        conaffinity=0,
    )


def _add_table(world: Element) -> None:
    centre = np.array([np.mean(TABLE_X), np.mean(TABLE_Y)])
    half = np.array([np.ptp(TABLE_X), np.ptp(TABLE_Y)]) / 2
    top = _slab(half, -TABLE_THICKNESS, 0.0)
    frame = _slab(half - 0.03, -TABLE_THICKNESS - 0.04, -TABLE_THICKNESS - 0.0005)
    legs = [
        along(barrel(0.028, TABLE_HEIGHT - TABLE_THICKNESS - 0.04, 0.003), Z, (x, y, -TABLE_HEIGHT))
        for x in (-half[0] + 0.09, half[0] - 0.09)
        for y in (-half[1] + 0.09, half[1] - 0.09)
    ]
    table = world.add("body", name="table", pos=(*centre, 0.0))
    add_visual(table, "table_top", top, "table_top")
    add_visual(table, "table_frame", joined(frame, *legs), "table_edge")
    box = (*half, TABLE_THICKNESS / 2)
    add_collision(
        table,
        "table_hull",
        of_arm=False,
        type="box",
        size=box,
        pos=(0.0, 0.0, -TABLE_THICKNESS / 2),
    )


def _slab(half: Float[np.ndarray, "2"], bottom: float, top: float) -> trimesh.Trimesh:
    """A flat board with softly rounded corners and a broken upper edge."""
    outline = superellipse(half[0], half[1], 14.0, around=160)
    edge = 0.003
    rings = ((bottom, 1.0), (top - edge, 1.0), (top, 1 - edge / half.max()))
    return loft(
        np.array([np.column_stack([s * outline, np.full(len(outline), z)]) for z, s in rings])
    )


def _housing() -> trimesh.Trimesh:
    """A machine-vision camera in its own frame (z forward, optical centre at the origin) with
    its lens.
    """
    body = trimesh.creation.box(
        (0.046, 0.046, 0.060), se3.pose(np.eye(3), np.array([0, 0, -0.064]))
    )
    lens = along(barrel(0.0185, 0.034, 0.002), Z, (0.0, 0.0, -0.036))
    ring = along(barrel(0.0205, 0.010, 0.001), Z, (0.0, 0.0, -0.024))
    return joined(body, lens, ring)


def _glass() -> trimesh.Trimesh:
    return along(barrel(0.013, 0.002, 0.0008), Z, (0.0, 0.0, -0.0035))


def _add_boom(stand: Element, centre: Float[np.ndarray, "3"]) -> None:
    """Crossbar over the cameras, boom back to the post, post down to the table."""
    height = centre[2] + BOOM_CLEARANCE + 0.025
    rails = {
        "crossbar": (
            (centre[0], centre[1] - 0.11, height - 0.005),
            (centre[0], centre[1] + 0.11, height - 0.005),
            0.014,
        ),
        "boom": ((centre[0] - 0.04, centre[1], height), (POST_X, centre[1], height), 0.018),
        "post": ((POST_X, centre[1], 0.0), (POST_X, centre[1], height + 0.05), POST_RADIUS),
    }
    for name, (start, end, radius) in rails.items():
        span = np.subtract(end, start)
        length = float(np.linalg.norm(span))
        add_visual(
            stand, name, along(barrel(radius, length, 0.003), tuple(span / length), start), "rail"
        )
        add_collision(
            stand,
            f"{name}_hull",
            of_arm=False,
            type="capsule",
            fromto=(*start, *end),
            size=(radius,),
        )
    foot = along(barrel(0.06, 0.012, 0.002), Z, (POST_X, centre[1], 0.0))
    clamp = along(barrel(0.034, 0.07, 0.004), Z, (POST_X, centre[1], height - 0.035))
    add_visual(stand, "stand_joints", joined(foot, clamp), "table_edge")
    size = (0.03, 0.085, 0.055)
    add_collision(
        stand,
        "cameras_hull",
        of_arm=False,
        type="box",
        size=size,
        pos=(centre[0], centre[1], centre[2] + 0.045),
    )
