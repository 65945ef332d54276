"""Quadratic finite elements of a breast that is linear elastic and clamped on the chest.

Young's modulus is 1 Pa throughout, or a ratio to it: displacements scale as 1/E, and how they
compare with one another does not depend on it.
"""

import numpy as np
import scipy.sparse
import skfem
from jaxtyping import Bool, Float, Int
from skfem.models.elasticity import lame_parameters

from breastscan.tissue.mesh import TetMesh
from breastscan.tissue.sparse_cholesky import SparseCholesky


def quadratic_elements(mesh: TetMesh) -> skfem.Basis:
    """Displacements that are quadratic in every tetrahedron."""
    tetrahedra = skfem.MeshTet(
        np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(mesh.tetrahedra.T)
    )
    return skfem.Basis(tetrahedra, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)


def skin_facets(basis: skfem.Basis, mesh: TetMesh) -> Int[np.ndarray, "k"]:
    """The facets on the skin, by their numbers."""
    facets = basis.mesh.boundary_facets()
    return facets[mesh.skin[np.asarray(basis.mesh.facets)[:, facets]].all(axis=0)]


def stiffness(
    basis: skfem.Basis, poisson: float, ratio: float | Float[np.ndarray, "e q"] = 1.0
) -> scipy.sparse.csr_array:
    """Stiffness of the solid [m].

    Args:
        basis: Its elements.
        poisson: Poisson's ratio [-].
        ratio: Young's modulus at the quadrature points over 1 Pa [-].
    """
    first, second = lame_parameters(1.0, poisson)
    # a tenth of the time of a form for each of 900 pairs: the products of all gradients first
    gradients = np.stack([np.asarray(shape[0].grad)[0] for shape in basis.basis[::3]])
    shapes, axes, elements, _ = gradients.shape
    by_element = np.moveaxis(gradients, 2, 0).reshape(elements, shapes * axes, -1)
    weights = np.broadcast_to(ratio, basis.dx.shape) * basis.dx
    products = (by_element * weights[:, None]) @ by_element.transpose(0, 2, 1)
    products = products.reshape(elements, shapes, axes, shapes, axes)
    local = first * products + second * products.transpose(0, 1, 4, 3, 2)
    local += second * np.einsum("eakbk,ij->eaibj", products, np.eye(axes))
    unknowns = np.asarray(basis.element_dofs).T
    rows = np.broadcast_to(unknowns[:, :, None], (*unknowns.shape, unknowns.shape[1]))
    columns = np.broadcast_to(unknowns[:, None], rows.shape)
    return scipy.sparse.csr_array(
        (local.ravel(), (rows.ravel(), columns.ravel())), shape=(basis.N, basis.N)
    )


class ClampedBody:
    """The factored stiffness of a breast on its chest."""

    def __init__(
        self, basis: skfem.Basis, mesh: TetMesh, stiffness: scipy.sparse.csr_array
    ) -> None:
        """Factor, for any number of loads."""
        by_node = node_unknowns(basis)
        self._free = ~_clamped(basis, mesh)
        self._unknowns = by_node[self._free].ravel()
        points = basis.doflocs[:, by_node[:, 0]].T
        self._factors = SparseCholesky(
            stiffness[self._unknowns][:, self._unknowns], points[self._free]
        )

    def displace(self, forces: Float[np.ndarray, "d k"]) -> Float[np.ndarray, "n 3 k"]:
        """Displacement of every node, as `node_unknowns` numbers them, for a Young's modulus of 1
        Pa [m].

        Args:
            forces: On the unknowns, a column for each load [N].
        """
        displacement = np.zeros((len(self._free), 3, forces.shape[1]))
        moved = self._factors.solve(forces[self._unknowns])
        displacement[self._free] = moved.reshape(-1, 3, forces.shape[1])
        return displacement


def node_unknowns(basis: skfem.Basis) -> Int[np.ndarray, "n 3"]:
    """The unknowns of every node: the corners first, and after them the mid-edge nodes."""
    return np.concatenate([np.asarray(basis.nodal_dofs), np.asarray(basis.edge_dofs)], axis=1).T


def _clamped(basis: skfem.Basis, mesh: TetMesh) -> Bool[np.ndarray, "n"]:
    """Nodes on the chest: its corners, and the middles between two of them."""
    ends = mesh.clamped[np.asarray(basis.mesh.edges)]
    return np.concatenate([mesh.clamped, ends.all(axis=0)])
