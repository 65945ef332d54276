"""How far pressing moves the touched skin across the probe axis, from the breast's shape alone.

On a flank the tissue yields towards the top: the skin under the probe moves up by a millimetre
while it is pressed in by six, so a probe pressed in at a point touches one that lies lower. In
homogeneous linear elasticity the ratio of the two depends on the shape and on Poisson's ratio, not
on Young's modulus: quadratic finite elements of the perceived shape, clamped on the chest, are
loaded where the probe will press.

The pressure is taken from where an undeformed face and skin would overlap, a fraction
`VIRTUAL_DEPTH` of the indentation deep, and grows with the root of the overlap [Ayasse]: half an
ellipse along the array, and about even across its narrow face. It acts along the skin's normals.
"""

from dataclasses import dataclass

import numpy as np
import skfem
from jaxtyping import Float
from scipy.interpolate import make_lsq_spline
from threadpoolctl import threadpool_limits

from breastscan.checks import require_positive
from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import Skin
from breastscan.tissue.elements import (
    ClampedBody,
    node_unknowns,
    quadratic_elements,
    skin_facets,
    stiffness,
)
from breastscan.tissue.mesh import Embed, mesh_breast
from breastscan.tissue.shape import StarShape

SKIN_POINTS = 400
"""Vertices of the finite elements on the skin, 9 mm apart: a second to assemble and factor."""
QUADRATURE = 8
"""Degree of polynomials that facets integrate exactly [-]: a patch is hardly wider than a facet."""
VIRTUAL_DEPTH = 0.64
"""Depth of the virtual overlap over the indentation [-]: the twin's contact is then as long."""
NOMINAL = 0.006
"""Indentation that the pressure is spread for [m]. From 3 to 7 mm the drag over its power 1.5 is
the same within 5 %, 11 % on small dense breasts."""
NOMINAL_FORCE = 5.0
"""Force that presses a tissue of 30 kPa in by as much [N]."""
HALFWAY_PLACES = 8
"""Around the breast, between its axis and its foot, that tell its size."""
PLACES = 33
"""Places of the path that are pressed."""
SECTIONS = 8
"""Sections of the cubic curve through them: what it smooths away is the mesh."""
SCALAR = skfem.ElementTetP2()
SHAPES = 10
"""Nodes of a quadratic tetrahedron."""
FARTHEST = 0.02
"""Facets farther along the axis from the place that is pressed lie on the other side [m]."""


@dataclass(frozen=True, kw_only=True)
class TissueConfig:
    """What must be known of tissue and probe to foretell how pressing moves the skin."""

    poisson: float = 0.45
    """Poisson's ratio of the tissue [-]."""
    array_radius: float = 0.060
    """Radius of the probe's face along its array [m]."""
    face_width: float = 0.012
    """Width of the part that presses, across the array [m]."""

    def __post_init__(self) -> None:
        require_positive(self, "planning.tissue")
        if not self.poisson < 0.5:
            raise ConfigError(
                f"planning.tissue.poisson must be below .5, got {self.poisson}: the finite "
                "elements cannot represent an incompressible solid, use .45 for soft tissue",
                self.poisson,
            )


def patch(force: float, skin: Skin, config: TissueConfig) -> tuple[float, float]:
    """Length along the array and width of what the probe touches [m], on skin that is as bent as a
    ball of this breast's size: the chord along which face and skin, each undeformed, overlap.

    Args:
        force: With which it presses [N].
        skin: The breast's.
        config: The probe's face.
    """
    depth = VIRTUAL_DEPTH * NOMINAL * (force / NOMINAL_FORCE) ** (2.0 / 3.0)
    azimuth = 2.0 * np.pi * np.arange(HALFWAY_PLACES) / HALFWAY_PLACES
    halfway = np.pi / 4.0 * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    bends = 1.0 / config.array_radius + 1.0 / skin.radius(halfway)[:, 0].mean()
    return 2.0 * float(np.sqrt(2.0 * depth / bends)), config.face_width


class PressedBreast:
    """A homogeneous breast of some shape in a frame A, on its chest, ready to be pressed."""

    def __init__(self, embed: Embed, config: TissueConfig) -> None:
        """Mesh the shape and factor its elasticity."""
        self._config = config
        mesh = mesh_breast(embed, SKIN_POINTS)
        basis = quadratic_elements(mesh)
        # the fronts are small, and threads that wait for each other cost more than they bring
        with threadpool_limits(1):
            self._body = ClampedBody(basis, mesh, stiffness(basis, config.poisson))
        self._basis = basis
        facets = skin_facets(basis, mesh)
        self._skin = skfem.FacetBasis(basis.mesh, SCALAR, facets=facets, intorder=QUADRATURE)
        self._corners_A = mesh.nodes[np.asarray(basis.mesh.facets)[:, facets].T]

    @staticmethod
    def perceived(
        points_A: Float[np.ndarray, "n 3"], chest: Plane, config: TissueConfig
    ) -> "PressedBreast":
        """The breast of which points were seen, on what holds its tissue.

        Raises:
            PlanningError: The points do not go round a breast.
        """
        return PressedBreast(StarShape.fit(points_A, chest).embed, config)

    def places(
        self,
        points_A: Float[np.ndarray, "k 3"],
        normals_A: Float[np.ndarray, "k 3"],
        up_A: Float[np.ndarray, "3"],
        force: float,
    ) -> Float[np.ndarray, "k 3"]:
        """Where the axis of a probe that touches these points meets the undeformed skin, or comes
        near it [m].

        Args:
            points_A: Points of the skin [m].
            normals_A: Unit normals there, against which the probe presses.
            up_A: The chest's normal, along none of those: the array lies across it.
            force: With which it presses [N].
        """
        x_A = np.cross(normals_A, up_A)
        x_A /= np.linalg.norm(x_A, axis=1, keepdims=True)
        R_AP = np.stack([x_A, -np.cross(normals_A, x_A), -normals_A], axis=-1)
        X_AP = se3.pose(R_AP, points_A)
        return points_A + NOMINAL**1.5 * force / NOMINAL_FORCE * self.drag(X_AP)

    def along_path(
        self, X_AP: Float[np.ndarray, "m 4 4"], s: Float[np.ndarray, "m"]
    ) -> Float[np.ndarray, "m 3"]:
        """`drag` all along a path, a smooth curve through some of its places [m^-1/2].

        Args:
            X_AP: The probe along the path, its tip on the undeformed skin.
            s: Length along the path [m].
        """
        rows = np.linspace(0, len(s) - 1, PLACES).round().astype(int)
        knots = np.linspace(s[0], s[-1], SECTIONS + 1)
        knots = np.concatenate([knots[[0] * 3], knots, knots[[-1] * 3]])
        smooth = make_lsq_spline(s[rows], self.drag(X_AP[rows]), knots, k=3)(s)
        return se3.across(smooth, X_AP[:, :3, 2])

    def drag(self, X_AP: Float[np.ndarray, "k 4 4"]) -> Float[np.ndarray, "k 3"]:
        """Motion of the touched skin across the probe axis in A, over the indentation's power 1.5
        [m^-1/2].

        Args:
            X_AP: The probe where it is to press, its tip on the undeformed skin or near it.
        """
        met = [self._meet(X) for X in X_AP]
        forces = np.stack([self._load(X, p_A) for X, (_, p_A) in zip(X_AP, met, strict=True)], 2)
        by_unknown = np.empty((self._basis.N, len(X_AP)))
        by_unknown[node_unknowns(self._basis).ravel()] = forces.reshape(-1, len(X_AP))
        with threadpool_limits(1):
            moved_A = self._body.displace(by_unknown)
        touched_A = np.stack([self._at(*place, moved_A[..., k]) for k, place in enumerate(met)])
        axes_A = X_AP[:, :3, 2]
        inward = np.sum(touched_A * axes_A, axis=1, keepdims=True)
        return (touched_A / inward - axes_A) / np.sqrt(NOMINAL)

    def _meet(self, X_AP: Float[np.ndarray, "4 4"]) -> tuple[int, Float[np.ndarray, "3"]]:
        """The skin's facet that the probe axis meets, or comes nearest to, and where [m]."""
        a, b, c = np.moveaxis(self._corners_A, 1, 0)
        axis_A = np.broadcast_to(-X_AP[:3, 2], a.shape)
        system = np.stack([b - a, c - a, axis_A], axis=2)
        s, t, away = np.linalg.solve(system, (X_AP[:3, 3] - a)[:, :, None])[:, :, 0].T
        inside = np.where(np.abs(away) < FARTHEST, np.minimum(np.minimum(s, t), 1 - s - t), -np.inf)
        facet = int(np.argmax(inside))
        return facet, X_AP[:3, 3] + away[facet] * X_AP[:3, 2]

    def _load(
        self, X_AP: Float[np.ndarray, "4 4"], p_A: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Nodal forces of a pressure under the probe, its tip at `p_A`, up to their size."""
        normals_A = np.moveaxis(np.asarray(self._skin.normals), 0, -1)
        points_A = np.moveaxis(np.asarray(self._skin.global_coordinates()), 0, -1)
        x, y, z = np.moveaxis((points_A - p_A) @ X_AP[:3, :3], -1, 0)
        face = VIRTUAL_DEPTH * NOMINAL - x**2 / (2 * self._config.array_radius)
        under = (np.abs(y) < self._config.face_width / 2) & (normals_A @ X_AP[:3, 2] < 0)
        pressure = np.sqrt(np.where(under, np.maximum(face - z, 0.0), 0.0))
        traction_A = -(pressure * self._skin.dx)[:, :, None] * normals_A
        shapes = np.stack([np.asarray(shape[0]) for shape in self._skin.basis], axis=2)
        forces_A = np.zeros((self._skin.N, 3))
        on_facets_A = np.einsum("fqa,fqc->fac", shapes, traction_A)
        np.add.at(forces_A, self._skin.element_dofs.T, on_facets_A)
        return forces_A

    def _at(
        self, facet: int, p_A: Float[np.ndarray, "3"], moved_A: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "3"]:
        """Displacement at a point of a facet, of those of all nodes."""
        element = np.asarray(self._skin.tind)[facet : facet + 1]
        local = self._skin.mapping.invF(p_A[:, None, None], tind=element)
        weights = [SCALAR.lbasis(local[:, 0], i)[0].item() for i in range(SHAPES)]
        return np.array(weights) @ moved_A[self._skin.element_dofs[:, facet]]
