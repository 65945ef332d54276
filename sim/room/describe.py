# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""Small helpers to write a MuJoCo description with `dm_control.mjcf`."""

from typing import Any

import cv2
import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from sim.cameras import opengl

try:  # dm_control opens an OpenGL display on import
    from dm_control import mjcf as mjcf
except (ImportError, AttributeError, RuntimeError) as error:
    raise opengl.missing(error) from error

Element = Any
"""An element of the description. dm_control gives it its attributes at run time, from MuJoCo's
schema."""
VISUAL_GROUP = 2
COLLISION_GROUP = 3
ARM_BIT, SURROUNDINGS_BIT = 1, 2
"""Collision bits: the arm and its tool meet the surroundings, never themselves."""


def placed(X_AB: Float[np.ndarray, "4 4"]) -> dict[str, np.ndarray]:
    """MJCF attributes that place B in its parent A."""
    quaternion = Rotation.from_matrix(X_AB[:3, :3]).as_quat(scalar_first=True)
    return {"pos": X_AB[:3, 3].copy(), "quat": quaternion}


def add_material(
    root: Element,
    name: str,
    rgba: tuple[float, float, float, float] = (1, 1, 1, 1),
    shine: float = 0.0,
    image: UInt8[np.ndarray, "h w 3"] | None = None,
) -> Element:
    """A material of one colour or with a picture; `shine` is its specular fraction."""
    texture = (
        None if image is None else root.asset.add("texture", name=name, type="2d", file=_png(image))
    )
    return root.asset.add(
        "material", name=name, rgba=rgba, specular=shine, shininess=shine, texture=texture
    )


def add_materials(
    root: Element, looks: dict[str, tuple[tuple[float, float, float, float], float]]
) -> None:
    """Materials of one colour by name, each with its specular fraction."""
    for name, (rgba, shine) in looks.items():
        add_material(root, name, rgba, shine)


def _png(image: UInt8[np.ndarray, "h w 3"]) -> mjcf.Asset:
    # it never leaves memory, so that compression would only take time
    options = [cv2.IMWRITE_PNG_COMPRESSION, 0]
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    return mjcf.Asset(encoded.tobytes(), ".png")


def add_visual(body: Element, name: str, mesh: trimesh.Trimesh, material: str) -> None:
    """A shape that is seen but neither weighs nor touches anything."""
    contents = mesh.export(file_type="stl")
    asset = body.root.asset.add(
        "mesh", name=name, file=mjcf.Asset(contents, ".stl"), inertia="shell"
    )
    add_mesh_geom(body, asset, material)


def add_mesh_geom(body: Element, asset: Element, material: str) -> None:
    """Show a mesh that was already described."""
    body.add(
        "geom",
        type="mesh",
        mesh=asset,
        material=material,
        group=VISUAL_GROUP,
        contype=0,
        conaffinity=0,
        mass=0,
    )


def add_collision(body: Element, name: str, *, of_arm: bool, **shape: object) -> None:
    """A shape that touches but is not seen and does not weigh."""
    own, other = (ARM_BIT, SURROUNDINGS_BIT) if of_arm else (SURROUNDINGS_BIT, ARM_BIT)
    body.add(
        "geom", name=name, group=COLLISION_GROUP, contype=own, conaffinity=other, mass=0, **shape
    )


def compiled(root: Element) -> mujoco.MjModel:
    """The model that a description makes."""
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def specification(root: Element) -> mujoco.MjSpec:
    """A description as MuJoCo has it, to be added to before it is compiled."""
    return mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
