"""Frictionless contact solved within the finite elements themselves: an oracle that shares only the
mesh.

Every node of the quadratic elements near the probe, mid-edge nodes included, may touch. Forces act
along the normals of the face where the displaced node lies, and the whole displacement counts, not
its normal part alone; the probe comes down in steps, so that no node is pushed out sideways.
"""

import numpy as np
import scipy.optimize
import scipy.sparse
import skfem
from jaxtyping import Float
from scipy.sparse.linalg import splu
from skfem.models.elasticity import lame_parameters, linear_elasticity

from breastscan.tissue.mesh import mesh_breast
from sim.tissue.phantom import Phantom
from sim.wrist.probe_face import ProbeFace, distance

STEP = 1e-3
"""Steps in which the probe comes down over the last 5 mm [m]."""
SETTLING = 3
"""Further linearisations at the end."""


def finite_element_force(
    phantom: Phantom, skin_points: int, face: ProbeFace, X_SP: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "3"]:
    """Force on the probe in S [N]."""
    mesh = mesh_breast(phantom.embed, skin_points)
    tets = skfem.MeshTet(mesh.nodes.T.copy(), mesh.tetrahedra.T.copy())
    basis = skfem.Basis(tets, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    stiffness = (
        linear_elasticity(*lame_parameters(phantom.config.young, phantom.config.poisson))
        .assemble(basis)
        .tocsc()
    )
    free = np.nonzero(basis.doflocs[2] > 1e-9)[0]
    factors = splu(
        stiffness[free][:, free], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )

    skin = tets.boundary_facets()[mesh.skin[tets.facets[:, tets.boundary_facets()]].all(axis=0)]
    nodes = np.unique(np.concatenate([tets.facets[:, skin].ravel()]))
    edges = np.unique(tets.f2e[:, skin].ravel())
    dofs = np.concatenate([basis.nodal_dofs[:, nodes], basis.edge_dofs[:, edges]], axis=1).T
    p_S = _onto_skin(phantom, basis.doflocs[:, dofs[:, 0]].T)
    chosen = (_signed_distance(face, X_SP, p_S)[0] < 0.003) & (p_S[:, 2] > 1e-9)
    p_S, rows = p_S[chosen], np.searchsorted(free, dofs[chosen]).ravel()
    loads = np.zeros((len(free), len(rows)))
    loads[rows, np.arange(len(rows))] = 1.0
    flexibility = factors.solve(loads)[rows]
    return _press_in_steps(face, X_SP, p_S, (flexibility + flexibility.T) / 2)


def _onto_skin(phantom: Phantom, p_S: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Mid-edge nodes lie a little below the smooth skin, on their straight edge; the probe meets
    the skin.
    """
    ball = phantom.inverse_map(p_S)
    return phantom.embed(ball / np.linalg.norm(ball, axis=1, keepdims=True))


def _press_in_steps(
    face: ProbeFace,
    X_SP: Float[np.ndarray, "4 4"],
    p_S: Float[np.ndarray, "n 3"],
    flexibility: Float[np.ndarray, "m m"],
) -> Float[np.ndarray, "3"]:
    displacement_S, force = np.zeros_like(p_S), np.zeros(len(p_S))
    outward_S = np.zeros_like(p_S)
    for height in (*np.arange(0.005, 0.0, -STEP), *[0.0] * SETTLING):
        X_raised = X_SP.copy()
        X_raised[:3, 3] -= height * X_SP[:3, 2]
        now, outward_S = _signed_distance(face, X_raised, p_S + displacement_S)
        gap = now - np.einsum("nc,nc->n", outward_S, displacement_S)
        along = scipy.sparse.block_diag(list(outward_S[:, :, None]), format="csr")
        half = np.linalg.cholesky(along.T @ (along.T @ flexibility).T)
        force, _ = scipy.optimize.nnls(half.T, np.linalg.solve(half, -gap))
        displacement_S = (flexibility @ (along @ force)).reshape(-1, 3)
    return -force @ outward_S


def _signed_distance(
    face: ProbeFace, X_SP: Float[np.ndarray, "4 4"], p_S: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Distance of points in S to the face [m] and its gradient."""
    found = np.array(
        [distance(face.parameters(), *p_P) for p_P in (p_S - X_SP[:3, 3]) @ X_SP[:3, :3]]
    )
    return found[:, 0], found[:, 1:] @ X_SP[:3, :3].T
