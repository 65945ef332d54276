"""The compliance of the skin: its displacement everywhere for a unit load anywhere, by quadratic
finite elements.

The phantom is linear elastic and clamped on the chest plate. The loads are pressures that are 1 at
one vertex of the skin and fall to 0 at its neighbours, directed along the vertex's inward normal.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse
import skfem
from jaxtyping import Float, Float32, Int
from skfem.helpers import ddot, dot, sym_grad, trace
from threadpoolctl import threadpool_limits

from breastscan.errors import ConfigError
from breastscan.tissue.elements import ClampedBody, quadratic_elements, skin_facets, stiffness
from breastscan.tissue.mesh import TetMesh, mesh_breast
from sim.tissue import half_space
from sim.tissue.half_space import Loads
from sim.tissue.layers import SKIN_THICKNESS, modulus_ratio
from sim.tissue.phantom import Phantom

Tell = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class SkinCompliance:
    """The skin's free vertices and their response to loads, for a Young's modulus of 1 Pa (it
    scales as 1/E).
    """

    vertices_S: Float[np.ndarray, "n 3"]
    """Vertices of the finite elements on the skin, without the clamped border [m]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals of the smooth skin."""
    direction: Float[np.ndarray, "n 3"]
    """The vertices on the unit hemisphere."""
    areas: Float[np.ndarray, "n"]
    """Area over which each vertex's unit load acts [m^2]."""
    response_S: Float32[np.ndarray, "n n 3"]
    """[j, i]: displacement in S of vertex i for an inward normal force of 1 N spread around vertex
    j [m]."""
    remainder: Float[np.ndarray, "n n"]
    """Inward displacement of vertex i for a unit inward force at vertex j, beyond a half-space's
    [m/N]; symmetric, and smooth on the diagonal too."""

    def scaled(self, factor: float) -> "SkinCompliance":
        """That of a body of the same shape, `factor` times as large: it is stiffer by as much,
        for the same force.
        """
        return replace(
            self,
            vertices_S=self.vertices_S * factor,
            areas=self.areas * factor**2,
            response_S=self.response_S / np.float32(factor),
            remainder=self.remainder / factor,
        )


def compute_compliance(
    phantom: Phantom, skin_points: int, progress: Tell | None = None
) -> SkinCompliance:
    """Solve the finite elements once for every vertex of the skin; twice where the tissue has
    layers.

    The layers' own part of the flexibility, the difference from homogeneous tissue on the same
    mesh, is smooth: the elements' errors near a load, where both have the same fat, cancel.

    Args:
        phantom: The shape, Poisson's ratio and the layers.
        skin_points: About how many vertices to put on the skin.
        progress: Told the fraction done (0 to 1) and what is being done.

    Raises:
        ConfigError: The layers have a mass so small that it falls between the elements.
    """
    tell = progress or (lambda _fraction, _what: None)
    tell(0.0, "meshing the tissue")
    mesh = mesh_breast(phantom.embed, skin_points)
    skin = np.nonzero(mesh.skin & (mesh.direction[:, 2] > 0))[0]
    vertices_S, normals_S = mesh.nodes[skin], phantom.normal(mesh.direction[skin])
    basis = quadratic_elements(mesh)
    facets = skin_facets(basis, mesh)
    forces, loads = _loads(basis, facets, skin, normals_S)
    poisson, layered = phantom.config.poisson, phantom.config.layers.present
    tell(0.1, "solving the tissue's elasticity")
    # the fronts are small, and threads that wait for each other cost more than they bring
    with threadpool_limits(1):
        response_S = _respond(basis, mesh, stiffness(basis, poisson), forces, skin)
        plain = _inward(response_S, normals_S)
        remainder = half_space.smooth_remainder(plain, vertices_S, normals_S, loads, poisson)
        if layered:
            tell(0.5, "solving the elasticity of the layers")
            ratio = _modulus_ratio(basis, phantom)
            with_layers = stiffness(basis, poisson, ratio) + _membrane(basis, facets, phantom)
            response_S = _respond(basis, mesh, with_layers, forces, skin)
            by_layers = _inward(response_S, normals_S) - plain
            remainder += (by_layers + by_layers.T) / 2
    tell(1.0, "solving the tissue's elasticity")
    return SkinCompliance(
        vertices_S=vertices_S,
        normals_S=normals_S,
        direction=mesh.direction[skin],
        areas=loads.areas,
        response_S=response_S.astype(np.float32),
        remainder=remainder,
    )


def _modulus_ratio(basis: skfem.Basis, phantom: Phantom) -> Float[np.ndarray, "e q"]:
    """Young's modulus over the fat's at the elements' quadrature points."""
    points_S = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    _require_seen(phantom, points_S)
    return modulus_ratio(
        phantom.config.layers, phantom.inverse_map(points_S), points_S, phantom.radius
    )


def _require_seen(phantom: Phantom, points_S: Float[np.ndarray, "*n 3"]) -> None:
    """Refuse a mass in which no point lies where the stiffness is taken."""
    layers = phantom.config.layers
    from_mass = np.linalg.norm(points_S - np.array(layers.mass_p_S), axis=-1)
    if layers.mass_radius > 0 and from_mass.min() > layers.mass_radius:
        raise ConfigError(
            f"a mass of mass_radius = {layers.mass_radius} m falls between the finite elements, "
            f"whose nearest point is {from_mass.min() * 1e3:.1f} mm from its centre: make it "
            "larger, or move it nearer to the skin, where they are finer",
            layers.mass_radius,
        )


def _membrane(
    basis: skfem.Basis, facets: Int[np.ndarray, "k"], phantom: Phantom
) -> scipy.sparse.csr_array:
    """Stiffness of the skin in its own plane, in plane stress: the strain's part in the facets
    [N/m].
    """
    poisson = phantom.config.poisson
    stretching = phantom.config.layers.skin_ratio * SKIN_THICKNESS / (1 - poisson**2)

    def energy(u, v, w):
        in_plane = np.eye(3)[:, :, None, None] - w.n[:, None] * w.n[None]
        a, b = (
            np.einsum("ijeq,jkeq,kleq->ileq", in_plane, sym_grad(field), in_plane)
            for field in (u, v)
        )
        return stretching * ((1 - poisson) * ddot(a, b) + poisson * trace(a) * trace(b))

    surface = skfem.FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=2)
    return scipy.sparse.csr_array(skfem.BilinearForm(energy).assemble(surface))


def _loads(
    basis: skfem.Basis,
    facets: Int[np.ndarray, "k"],
    skin: Int[np.ndarray, "n"],
    normals_S: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "d n"], Loads]:
    """The vertices' loads, and the consistent nodal forces of each of them, one column each [N]."""
    vector = skfem.FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=3)
    hats = skfem.FacetBasis(
        basis.mesh, skfem.ElementVector(skfem.ElementTetP1()), facets=facets, intorder=3
    )
    traction = skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(hats, vector).tocsc()
    hat_dofs = np.asarray(hats.nodal_dofs)[:, skin]
    inward = scipy.sparse.csc_array(
        (-normals_S.ravel(), (hat_dofs.T.ravel(), np.repeat(np.arange(len(skin)), 3))),
        shape=(hats.N, len(skin)),
    )
    areas = skfem.LinearForm(lambda v, _: v[0]).assemble(hats)[hat_dofs[0]]
    first = skfem.LinearForm(lambda v, w: dot(v, w.x)).assemble(hats)[hat_dofs].T
    second = skfem.LinearForm(lambda v, w: v[0] * dot(w.x, w.x)).assemble(hats)[hat_dofs[0]]
    centres_S = first / areas[:, None]
    loads = Loads(
        areas=areas, centres_S=centres_S, moments=second / areas - np.sum(centres_S**2, axis=1)
    )
    return scipy.sparse.csc_array(traction @ inward).toarray() / areas, loads


def _respond(
    basis: skfem.Basis,
    mesh: TetMesh,
    stiffness: scipy.sparse.csr_array,
    forces: Float[np.ndarray, "d n"],
    skin: Int[np.ndarray, "n"],
) -> Float[np.ndarray, "n n 3"]:
    """Displacement of every vertex of the skin for every load [m]: [load, vertex, axis]."""
    return ClampedBody(basis, mesh, stiffness).displace(forces)[skin].transpose(2, 0, 1)


def _inward(
    response_S: Float[np.ndarray, "n n 3"], normals_S: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n n"]:
    """Inward displacement of vertex i for 1 N of load j [m/N].

    A point is displaced by a distributed load, so Maxwell's reciprocity is kept to the order of the
    mesh only; the contact needs it exactly to conserve energy, so what is made of this is made
    symmetric.
    """
    return -np.einsum("jic,ic->ij", response_S, normals_S)
