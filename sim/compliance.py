"""How the skin gives: its displacement everywhere for a unit load anywhere, by quadratic finite elements.

The phantom is linear elastic and clamped on the chest plate. The loads are pressures that are 1 at one vertex of the
skin and fall to 0 at its neighbours, directed along the vertex's inward normal.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import skfem
from jaxtyping import Float, Float32, Int
from scipy.sparse.linalg import SuperLU, splu
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from sim.mesh import TetMesh, mesh_phantom
from sim.phantom import Phantom

LOADS_AT_ONCE = 64
"""Right-hand sides a solve: the factors are read once for all of them."""


@dataclass(frozen=True, kw_only=True)
class SkinCompliance:
    """The skin's free vertices and their response to loads, for a Young's modulus of 1 Pa (it scales as 1/E)."""

    vertices_S: Float[np.ndarray, "n 3"]
    """Vertices of the finite elements on the skin, without the clamped border [m]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals of the smooth skin."""
    direction: Float[np.ndarray, "n 3"]
    """The vertices on the unit hemisphere."""
    areas: Float[np.ndarray, "n"]
    """Area over which each vertex's unit load acts [m^2]."""
    response_S: Float32[np.ndarray, "n n 3"]
    """[j, i]: displacement in S of vertex i for an inward normal force of 1 N spread around vertex j [m]."""

    def normal_flexibility(self) -> Float[np.ndarray, "n n"]:
        """Inward displacement of vertex i for a unit inward force at vertex j [m/N], made exactly symmetric.

        The finite elements answer with a point's displacement to a spread load, so that they keep Maxwell's
        reciprocity only to the order of the mesh; the contact needs it exactly to conserve energy.
        """
        flexibility = -np.einsum("jic,ic->ij", self.response_S, self.normals_S).astype(float)
        return (flexibility + flexibility.T) / 2


def compute_compliance(
    phantom: Phantom, skin_points: int, progress: Callable[[float, str], None] | None = None
) -> SkinCompliance:
    """Solve the finite elements once for every vertex of the skin.

    Args:
        phantom: The shape, and Poisson's ratio.
        skin_points: About how many vertices to put on the skin.
        progress: Told the share done (0 to 1) and what is being done.
    """
    tell = progress or (lambda _share, _what: None)
    tell(0.0, "meshing the tissue")
    mesh = mesh_phantom(phantom, skin_points)
    skin = np.nonzero(mesh.skin & (mesh.direction[:, 2] > 0))[0]
    normals_S = phantom.normal(mesh.direction[skin])

    tell(0.02, "assembling the tissue's stiffness")
    basis = skfem.Basis(_skfem_mesh(mesh), skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    stiffness = linear_elasticity(*lame_parameters(1.0, phantom.config.poisson)).assemble(basis).tocsc()
    free = np.nonzero(basis.doflocs[2] > 1e-9)[0]
    loads, areas = _loads(basis, mesh, skin, normals_S)

    tell(0.1, "factorising the tissue's stiffness")
    factors = splu(
        stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    rows = np.searchsorted(free, np.asarray(basis.nodal_dofs)[:, skin].T)
    response_S = _solve(factors, scipy.sparse.csc_array(loads[free] @ scipy.sparse.diags_array(1 / areas)), rows, tell)
    return SkinCompliance(
        vertices_S=mesh.nodes_S[skin],
        normals_S=normals_S,
        direction=mesh.direction[skin],
        areas=areas,
        response_S=response_S,
    )


def _skfem_mesh(mesh: TetMesh) -> skfem.MeshTet:
    return skfem.MeshTet(np.ascontiguousarray(mesh.nodes_S.T), np.ascontiguousarray(mesh.tetrahedra.T))


def _loads(
    basis: skfem.Basis, mesh: TetMesh, skin: Int[np.ndarray, "n"], normals_S: Float[np.ndarray, "n 3"]
) -> tuple[scipy.sparse.csc_array, Float[np.ndarray, "n"]]:
    """Consistent nodal forces of each vertex's unit load [N/Pa], one column each, and the loads' areas [m^2]."""
    facets = basis.mesh.boundary_facets()
    facets = facets[mesh.skin[np.asarray(basis.mesh.facets)[:, facets]].all(axis=0)]
    vector = skfem.FacetBasis(basis.mesh, basis.elem, facets=facets, intorder=3)
    hat = skfem.FacetBasis(basis.mesh, skfem.ElementVector(skfem.ElementTetP1()), facets=facets, intorder=3)
    traction = skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(hat, vector).tocsc()
    hat_dofs = np.asarray(hat.nodal_dofs)[:, skin]
    inward = scipy.sparse.csc_array(
        (-normals_S.ravel(), (hat_dofs.T.ravel(), np.repeat(np.arange(len(skin)), 3))),
        shape=(hat.N, len(skin)),
    )
    areas = skfem.LinearForm(lambda v, _: v[0]).assemble(hat)[hat_dofs[0]]
    return scipy.sparse.csc_array(traction @ inward), areas


def _solve(
    factors: SuperLU,
    loads: scipy.sparse.csc_array,
    rows: Int[np.ndarray, "n 3"],
    tell: Callable[[float, str], None],
) -> Float32[np.ndarray, "n n 3"]:
    """Displacements of the degrees of freedom `rows` for every load."""
    count = len(rows)
    response = np.empty((count, *rows.shape), np.float32)
    for start in range(0, count, LOADS_AT_ONCE):
        some = slice(start, min(start + LOADS_AT_ONCE, count))
        response[some] = factors.solve(np.asfortranarray(loads[:, some].toarray()))[rows].transpose(2, 0, 1)
        tell(0.3 + 0.7 * some.stop / count, "solving the tissue's compliance")
    return response
