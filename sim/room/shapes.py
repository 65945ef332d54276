"""Procedural shapes: lathed housings, caps and tubes, lofts along a curve.

All lengths in metres. Shapes of revolution have their axis along z and start at z = 0.
"""

from typing import cast

import numpy as np
import trimesh
from jaxtyping import Float

from breastscan.geometry import se3

SECTIONS = 64
"""Facets around every shape of revolution: its silhouette then departs from a circle by .1% of the
radius."""

Point = tuple[float, float, float]
Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
MINUS_X = (-1.0, 0.0, 0.0)
MINUS_Y = (0.0, -1.0, 0.0)
MINUS_Z = (0.0, 0.0, -1.0)
Profile = list[tuple[float, float]]
"""Outline (radius, height) [m] of a shape of revolution, from the axis at the bottom to the axis at
the top."""


def lathe(profile: Profile) -> trimesh.Trimesh:
    """The outline revolved about z."""
    return trimesh.creation.revolve(np.array(profile), sections=SECTIONS)


def barrel(radius: float, length: float, chamfer: float = 0.004) -> trimesh.Trimesh:
    """A cylinder with rounded rims."""
    angle = np.linspace(0, np.pi / 2, 6)
    radii, heights = radius - chamfer * (1 - np.cos(angle)), chamfer * np.sin(angle)
    top = [(r, length - chamfer + h) for r, h in zip(radii, heights, strict=True)]
    bottom = [(r, length - h) for r, h in top[::-1]]
    return lathe([(0.0, 0.0), *bottom, *top, (0.0, length)])


def tube(start_radius: float, end_radius: float, length: float) -> trimesh.Trimesh:
    """A slightly conical tube."""
    return lathe([(0.0, 0.0), (start_radius, 0.0), (end_radius, length), (0.0, length)])


def cap(radius: float, height: float) -> trimesh.Trimesh:
    """A lid: a short straight rim, a rounded shoulder and a flat, shallow dish inside it."""
    rim = 0.35 * height
    shoulder = 0.18 * radius
    dish = 0.12 * height
    angle = np.linspace(0, np.pi / 2, 8)
    rounding = [
        (radius - shoulder * (1 - np.cos(a)), rim + (height - rim) * np.sin(a)) for a in angle
    ]
    inner = radius - shoulder - 0.08 * radius
    return lathe(
        [
            (0.0, 0.0),
            (radius, 0.0),
            *rounding,
            (inner, height),
            (inner - 0.004, height - dish),
            (0.0, height - dish),
        ]
    )


def loft(rings: Float[np.ndarray, "k n 3"]) -> trimesh.Trimesh:
    """A closed skin over successive rings of points, with flat ends."""
    count, around, _ = rings.shape
    first, second = np.arange(around), np.roll(np.arange(around), -1)
    faces = []
    for k in range(count - 1):
        low, high = k * around, (k + 1) * around
        faces += [np.stack([low + first, low + second, high + first], 1)]
        faces += [np.stack([low + second, high + second, high + first], 1)]
    bottom, top = count * around, count * around + 1
    faces += [np.stack([np.full(around, bottom), second, first], 1)]
    faces += [
        np.stack([np.full(around, top), bottom - around + first, bottom - around + second], 1)
    ]
    vertices = np.vstack([rings.reshape(-1, 3), rings[0].mean(0), rings[-1].mean(0)])
    mesh = trimesh.Trimesh(vertices, np.vstack(faces), process=False)
    mesh.fix_normals()
    return mesh


def superellipse(
    half_x: float, half_y: float, exponent: float, around: int = SECTIONS
) -> Float[np.ndarray, "n 2"]:
    """Points on |x / half_x|^exponent + |y / half_y|^exponent = 1: a rectangle with soft corners
    where exponent > 2.
    """
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    wave = np.stack([np.cos(angle), np.sin(angle)], 1)
    return np.array([half_x, half_y]) * np.sign(wave) * np.abs(wave) ** (2 / exponent)


def hose(centres: Float[np.ndarray, "k 3"], radius: float) -> trimesh.Trimesh:
    """A round tube along a smooth plane curve given by its points."""
    tangents = np.gradient(centres, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(tangents, _plane_normal(tangents))
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None]
    rings = [
        c + radius * (np.cos(angle) * u + np.sin(angle) * np.cross(t, u))
        for c, u, t in zip(centres, across, tangents, strict=True)
    ]
    return loft(np.array(rings))


def _plane_normal(tangents: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "3"]:
    """Unit normal of the plane in which a curve with these tangents lies."""
    normal = np.linalg.svd(tangents)[2][-1]
    return normal / np.linalg.norm(normal)


def moved(mesh: trimesh.Trimesh, X_AB: Float[np.ndarray, "4 4"]) -> trimesh.Trimesh:
    """The mesh given in B, expressed in A."""
    return mesh.copy().apply_transform(X_AB)


def along(mesh: trimesh.Trimesh, axis: Point, start: Point) -> trimesh.Trimesh:
    """A shape of revolution with its axis laid along the unit vector `axis` from `start` [m]."""
    z = np.array(axis, float)
    helper = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return moved(mesh, se3.pose(np.stack([x, np.cross(z, x), z], 1), np.array(start, float)))


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """Several shapes as one."""
    return cast(trimesh.Trimesh, trimesh.util.concatenate(list(meshes)))
