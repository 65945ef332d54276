"""A graded tetrahedral mesh of a breast, without a mesher.

Points on concentric half-shells of the unit half-ball, Delaunay's tetrahedra between them, the
shape's smooth map. The spacing is finest on the skin and grows inwards, where nothing varies fast.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay

GROWTH = 1.45
"""Ratio of the spacings of neighbouring shells [-]."""
LAYER = 0.8
"""Distance of two shells over the spacing of the outer one's points [-]."""
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Rotation between successive points of a Fibonacci spiral [rad]."""
FLAT = 1e-3
"""A tetrahedron of a smaller volume than this fraction of its longest edge cubed is a sliver of
coplanar points [-]."""

Embed = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]]
"""A breast's shape: points of the unit half-ball z >= 0 mapped into it [m]. Points at distance 1
become the skin, those with z = 0 lie on the chest."""


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra of the undeformed breast, and which of their corners lie on the skin."""

    nodes: Float[np.ndarray, "n 3"]
    """Corners, in the shape's own frame [m]."""
    tetrahedra: Int[np.ndarray, "m 4"]
    direction: Float[np.ndarray, "n 3"]
    """The corners in the unit half-ball."""
    skin: Bool[np.ndarray, "n"]
    """Corners on the skin, its clamped border included."""

    @property
    def clamped(self) -> Bool[np.ndarray, "n"]:
        """Corners on the chest."""
        return self.direction[:, 2] == 0


def mesh_breast(embed: Embed, skin_points: int) -> TetMesh:
    """Mesh a shape with about `skin_points` points on its skin."""
    shells = _half_shells(np.sqrt(2 * np.pi / skin_points / (np.sqrt(3) / 2)))
    ball = np.concatenate(shells)
    skin = np.arange(len(ball)) < len(shells[0])
    nodes = embed(ball)
    tetrahedra = _drop_slivers(ball, Delaunay(ball).simplices.astype(np.int64))
    return TetMesh(nodes, tetrahedra, ball, skin)


def skin_triangles(mesh: TetMesh) -> Int[np.ndarray, "k 3"]:
    """The skin's facets, counter-clockwise seen from outside."""
    faces = mesh.tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    faces = faces[mesh.skin[faces].all(axis=1)]
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    faces = faces[first[count == 1]]
    faces = faces[mesh.direction[faces, 2].max(axis=1) > 0]
    a, b, c = mesh.direction[faces].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _half_shells(spacing: float) -> list[Float[np.ndarray, "_ 3"]]:
    """Points of the half-ball, outermost shell first, with `spacing` on the unit hemisphere."""
    shells = []
    radius = 1.0
    while radius > spacing:
        shells.append(radius * half_shell(spacing / radius, rotation=float(len(shells))))
        radius -= LAYER * spacing
        spacing *= GROWTH
    return [*shells, np.zeros((1, 3))]


def half_shell(spacing: float, rotation: float) -> Float[np.ndarray, "n 3"]:
    """A Fibonacci spiral on the unit hemisphere, and a ring of points on its border."""
    count = max(int(2 * np.pi / (np.sqrt(3) / 2 * spacing**2)), 4)
    z = 1 - (np.arange(count) + 0.5) / count
    z = z[z > 0.6 * spacing]
    spiral = GOLDEN_ANGLE * np.arange(len(z)) + rotation
    ring = np.linspace(0, 2 * np.pi, max(int(2 * np.pi / spacing), 6), endpoint=False) + rotation
    z, azimuth = np.append(z, np.zeros(len(ring))), np.append(spiral, ring)
    sine = np.sqrt(1 - z**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=1)


def _drop_slivers(
    points: Float[np.ndarray, "n 3"], tetrahedra: Int[np.ndarray, "m 4"]
) -> Int[np.ndarray, "k 4"]:
    """The tetrahedra that are not flat, each oriented to a positive volume."""
    a, b, c, d = points[tetrahedra].transpose(1, 0, 2)
    volume = (np.cross(b - a, c - a) * (d - a)).sum(axis=1) / 6
    longest = np.max(
        [
            np.linalg.norm(p - q, axis=1)
            for p, q in ((a, b), (a, c), (a, d), (b, c), (b, d), (c, d))
        ],
        axis=0,
    )
    oriented = np.where(volume[:, None] < 0, tetrahedra[:, [0, 2, 1, 3]], tetrahedra)
    return oriented[np.abs(volume) > FLAT * longest**3]
