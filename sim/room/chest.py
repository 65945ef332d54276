"""The chest as a thing: what is seen of it, what touches it, and how far it is.

A block whose top is the chest of `sim.tissue.chest`, flat or a parabolic cylinder, and which
reaches into the table.
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, UInt8

from sim.room.describe import Element, add_collision, add_material, add_mesh_geom, placed
from sim.room.shapes import loft, superellipse
from sim.tissue.chest import nearest_across
from sim.tissue.phantom import PLATE_SIDE

PLATE_HALF = (0.175, 0.205)
"""Half lengths of the chest's top along x and y [m]."""
PLATE_ROUNDING = 0.045
"""Radius of the chest's shoulders [m]."""
CHEST = "phantom"
"""Name of the chest's body, whose frame is S. It is the first of the mocap bodies: breathing moves
it."""
CHEST_HULL = "chest_hull"
"""Name of the chest's collision shape."""
HULL_EDGES = 65
"""Points across the hull of a curved chest: it lies within .04 mm of the surface."""
PICTURE_SAG = 2e-5
"""How far the drawn facets of a curved chest may lie beside it [m]."""


def add_chest(
    root: Element,
    X_BS: Float[np.ndarray, "4 4"],
    curvature: float,
    image: UInt8[np.ndarray, "h w 3"] | None,
) -> None:
    """The chest, to be touched and to be seen.

    Args:
        root: The description to add to.
        X_BS: The patient's frame, in the middle of the breast's base.
        curvature: Across the body's long axis [1/m].
        image: Texture of the chest; None where only its shape counts.
    """
    chest = root.worldbody.add("body", name=CHEST, mocap=True, **placed(X_BS))
    half, depth = chest_block(X_BS, curvature)
    if curvature == 0:
        size = (*half, depth / 2)
        add_collision(
            chest, CHEST_HULL, of_arm=False, type="box", size=size, pos=(0.0, 0.0, -depth / 2)
        )
    else:
        vertices_S = _hull(half, depth, curvature)
        asset = root.asset.add("mesh", name=CHEST_HULL, vertex=vertices_S.ravel(), inertia="convex")
        add_collision(chest, CHEST_HULL, of_arm=False, type="mesh", mesh=asset)
    if image is not None:
        add_material(root, "chest", image=image)
        _add_torso(chest, depth, curvature)


def chest_block(
    X_BS: Float[np.ndarray, "4 4"], curvature: float
) -> tuple[Float[np.ndarray, "2"], float]:
    """Half lengths of the chest's top along x and y, and how far below S the block ends, in or
    under the table [m].
    """
    lowered = (max(PLATE_HALF) + PLATE_ROUNDING) * np.hypot(*X_BS[:2, 2])
    depth = float(X_BS[2, 3] + lowered)
    half = np.array(PLATE_HALF)
    if curvature > 0:
        half[1] = min(half[1], math.sqrt(2 * depth / curvature))
    return half, depth


@numba.njit(cache=True)
@no_type_check
def chest_distance(curvature, half, x, y, z):
    """Signed distance of a point of S to a curved chest, whose block has no bottom [m]."""
    nearest = min(max(nearest_across(curvature, y, z), -half[1]), half[1])
    off = z + curvature * nearest * nearest / 2
    to_top = math.sqrt((y - nearest) ** 2 + off * off)
    beside_x = abs(x) - half[0]
    beside_y = abs(y) - half[1]
    if z + curvature * y * y / 2 > 0:
        across = to_top
    elif beside_y > 0:
        across = beside_y
    else:
        across = -min(to_top, -beside_y)
    outside_x = max(beside_x, 0.0)
    outside = max(across, 0.0)
    return math.sqrt(outside_x**2 + outside**2) + min(max(across, beside_x), 0.0)


def _hull(half: Float[np.ndarray, "2"], depth: float, curvature: float) -> Float[np.ndarray, "n 3"]:
    """Corners of a curved chest, which is convex [m]."""
    y = np.linspace(-half[1], half[1], HULL_EDGES)
    top = np.stack([y, -curvature * y**2 / 2], axis=1)
    outline = np.vstack([top, [[-half[1], -depth], [half[1], -depth]]])
    ends = [np.column_stack([np.full(len(outline), x), outline]) for x in (-half[0], half[0])]
    return np.vstack(ends)


def _evenly(outline: Float[np.ndarray, "n 2"], count: int) -> Float[np.ndarray, "k 2"]:
    """So many points of a dense closed outline, at equal distances along it."""
    closed = np.vstack([outline, outline[:1]])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1)))
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, along, column) for column in closed.T])


def _add_torso(chest: Element, depth: float, curvature: float) -> None:
    """A block whose shoulders roll off to the table; its picture is unrolled over them, and all of
    it follows the chest's curve.
    """
    outline = superellipse(*PLATE_HALF, 5.0, around=160)
    if curvature > 0:
        outline = _evenly(superellipse(*PLATE_HALF, 5.0, around=20_000), 320)
    outward = outline / np.linalg.norm(outline, axis=1, keepdims=True)
    rounding = min(PLATE_ROUNDING, depth)
    angle = np.linspace(0, np.pi / 2, 16)
    grow = np.append(rounding * np.sin(angle), rounding)
    drop = np.append(rounding * (1 - np.cos(angle)), depth)
    unrolled = np.append(rounding * angle, rounding * (np.pi / 2 - 1) + depth)
    parts = int(max(PLATE_HALF) * math.sqrt(curvature / (8 * PICTURE_SAG)))
    inner = [outline * part / parts for part in range(1, parts)]
    rings = np.array(
        [
            *[np.column_stack([ring, np.zeros(len(ring))]) for ring in inner],
            *[
                np.column_stack([outline + g * outward, np.full(len(outline), -z)])
                for g, z in zip(grow, drop, strict=True)
            ],
        ]
    )
    rings[..., 2] -= curvature * rings[..., 1] ** 2 / 2
    flat = np.array([*inner, *[outline + distance * outward for distance in unrolled]])
    mesh = loft(rings)
    texcoord = 0.5 + np.vstack([flat.reshape(-1, 2), [[0, 0], [0, 0]]]) / PLATE_SIDE
    asset = chest.root.asset.add(
        "mesh",
        name="chest",
        vertex=mesh.vertices.ravel(),
        face=mesh.faces.ravel(),
        texcoord=texcoord.ravel(),
        inertia="shell",
    )
    add_mesh_geom(chest, asset, "chest")
