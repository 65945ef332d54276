"""The reference for the soft phantom: full quadratic finite elements, large deformations, contact
where it happens.

Shares nothing with `sim.tissue.soft` but the phantom's shape and the probe's face. The material is
neo-Hookean (for small strains it is Hooke's), the equilibrium is that of the deformed body, and the
traction acts along the normals of the probe's face wherever the displaced skin lies. The contact is
a stiff penalty, the equations are solved by Newton's method, its linear systems by conjugate
gradients with the linear elements as a coarse level.
"""

from typing import no_type_check

import numba
import numpy as np
import scipy.sparse
import skfem
from jaxtyping import Float, Int
from skfem.models.elasticity import lame_parameters

from experiments.local_mesh import local_mesh
from experiments.two_level import TwoLevel
from sim.tissue.layers import modulus_ratio
from sim.tissue.phantom import Phantom
from sim.wrist.probe_face import ProbeFace, components_P, distance

PENALTY = 1e5
"""Contact pressure per penetration, over Young's modulus [1/m]: .01 mm at a pressure of E."""
NEWTON_STEPS = 40
TOLERANCE = 1e-4
"""Unbalanced force over contact force at which a step has converged [-]."""
SHORTEST = 1 / 64
"""Smallest fraction of a Newton step that is tried [-]."""
NEAR = (0.045, 0.020, 0.030)
"""Half size, about P, of the box in which skin may touch [m]."""


class FullTissue:
    """The breast in equilibrium with the probe; start with small depths and go deeper in steps
    of a millimetre.
    """

    def __init__(self, phantom: Phantom, X_SP: Float[np.ndarray, "4 4"], finest: float) -> None:
        """Mesh and prepare.

        Args:
            phantom: Shape, elasticity and layers; the skin's membrane is left out.
            X_SP: About where the probe will press: the mesh is fine there.
            finest: Longest edge there [m].
        """
        self._face = ProbeFace().parameters()
        mesh = local_mesh(phantom, X_SP, finest)
        basis = skfem.Basis(mesh, skfem.ElementTetP2(), intorder=2)
        self.nodes_S: Float[np.ndarray, "n 3"] = basis.doflocs.T.copy()
        self.displacement_S = np.zeros_like(self.nodes_S)
        self._elements = basis.element_dofs.T.astype(np.int64)
        self._gradients = np.ascontiguousarray(
            np.stack([np.asarray(b[0].grad) for b in basis.basis]).transpose(2, 3, 0, 1)
        )
        self._weights = basis.dx
        self._lame = _lame(phantom, basis)
        self._penalty = PENALTY * phantom.config.young
        self._free = self.nodes_S[:, 2] > 1e-9
        self._number = np.where(self._free, np.cumsum(self._free) - 1, -1)
        self._pattern, self._places = _block_pattern(self._number[self._elements])
        self._solver = TwoLevel(_prolongation(mesh, self._free))
        self._prepare_contact(phantom, mesh, X_SP)

    def press(self, X_SP: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
        """Force on the probe in S [N], in equilibrium.

        Raises:
            ArithmeticError: Newton's method does not converge, or an element is inverted.
        """
        X_SP = np.ascontiguousarray(X_SP)
        residual, blocks, force_S = self._equations(self.displacement_S, X_SP)
        for _ in range(NEWTON_STEPS):
            if np.linalg.norm(residual) < TOLERANCE * max(np.linalg.norm(force_S), 1e-9):
                return force_S
            step = np.zeros_like(self.displacement_S)
            step[self._free] = -self._solver.solve(blocks, residual)
            fraction = 1.0
            while True:
                moved = self.displacement_S + fraction * step
                trial, trial_blocks, trial_force_S = self._equations(moved, X_SP)
                if np.linalg.norm(trial) < (1 - 0.01 * fraction) * np.linalg.norm(residual):
                    break
                fraction /= 2
                if fraction < SHORTEST:  # a contact that jumps makes the residual rise once
                    if not np.isfinite(trial).all():
                        raise ArithmeticError("an element is inverted: go deeper in smaller steps")
                    break
            self.displacement_S = moved
            residual = trial
            blocks = trial_blocks
            force_S = trial_force_S
        raise ArithmeticError(
            f"no equilibrium after {NEWTON_STEPS} Newton steps: go deeper in smaller steps"
        )

    def skin(self, X_SP: Float[np.ndarray, "4 4"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of the smooth skin near the probe, undeformed and displaced, in S [m], and
        their areas [m^2].
        """
        moved_S = self._skin_S + np.einsum(
            "fqa,fac->fqc", self._shapes, self.displacement_S[self._facets]
        )
        return self._skin_S.reshape(-1, 3), moved_S.reshape(-1, 3), self._areas.ravel()

    def _equations(
        self, displacement_S: Float[np.ndarray, "n 3"], X_SP: Float[np.ndarray, "4 4"]
    ) -> tuple[Float[np.ndarray, "m 3"], scipy.sparse.bsr_array, Float[np.ndarray, "3"]]:
        """Unbalanced forces of the free nodes [N], their derivatives [N/m], and the force on the
        probe [N].
        """
        residual, force_S = np.zeros_like(displacement_S), np.zeros(3)
        data = np.zeros((self._pattern.nnz, 3, 3))
        valid = _add_elastic(
            residual,
            data,
            displacement_S,
            self._elements,
            self._places,
            self._gradients,
            self._weights,
            *self._lame,
        )
        if not valid:
            residual[:] = np.inf
        _add_contact(
            residual,
            data,
            force_S,
            displacement_S,
            self._facets,
            self._facet_places,
            self._shapes,
            self._skin_S,
            self._areas,
            self._face,
            X_SP,
            self._penalty,
        )
        size = 3 * (len(self._pattern.indptr) - 1)
        blocks = scipy.sparse.bsr_array(
            (data, self._pattern.indices, self._pattern.indptr), shape=(size, size)
        )
        return residual[self._free], blocks, force_S

    def _prepare_contact(
        self, phantom: Phantom, mesh: skfem.MeshTet, X_SP: Float[np.ndarray, "4 4"]
    ) -> None:
        """Quadrature points of the skin near the probe; on the smooth surface, of which the
        facets are chords.
        """
        facets = mesh.boundary_facets()
        corners = np.asarray(mesh.facets)[:, facets]
        centroids_P = (mesh.p[:, corners].mean(axis=1).T - X_SP[:3, 3]) @ X_SP[:3, :3]
        skin = (mesh.p[2][corners] > 1e-9).any(axis=0) & (np.abs(centroids_P) < NEAR).all(axis=1)
        basis = skfem.FacetBasis(mesh, skfem.ElementTetP2(), facets=facets[skin], intorder=5)
        self._facets = basis.element_dofs.T.astype(np.int64)
        self._facet_places = self._places[basis.tind]
        self._shapes = np.ascontiguousarray(
            np.stack([np.asarray(b[0]) for b in basis.basis]).transpose(1, 2, 0)
        )
        self._areas = basis.dx
        ball = phantom.inverse_map(
            np.einsum("fqa,fac->fqc", self._shapes, self.nodes_S[self._facets])
        )
        self._skin_S = phantom.embed(ball / np.linalg.norm(ball, axis=2, keepdims=True))


def _lame(
    phantom: Phantom, basis: skfem.Basis
) -> tuple[Float[np.ndarray, "e q"], Float[np.ndarray, "e q"]]:
    """Lame's parameters [Pa] in every quadrature point."""
    config = phantom.config
    points_S = np.asarray(basis.global_coordinates()).transpose(1, 2, 0)
    ratio = modulus_ratio(config.layers, phantom.inverse_map(points_S), points_S, phantom.radius)
    first, second = lame_parameters(config.young, config.poisson)
    return first * ratio, second * ratio


def _block_pattern(
    numbers: Int[np.ndarray, "e 10"],
) -> tuple[scipy.sparse.csr_array, Int[np.ndarray, "e 10 10"]]:
    """Which free nodes meet in an element, and where each element's pairs stand among the
    blocks; -1 if clamped.
    """
    count = numbers.max() + 1
    rows, columns = np.broadcast_arrays(numbers[:, :, None], numbers[:, None, :])
    met = (rows >= 0) & (columns >= 0)
    pairs, places = np.unique(rows[met] * count + columns[met], return_inverse=True)
    indptr = np.searchsorted(pairs, np.arange(count + 1) * count)
    pattern = scipy.sparse.csr_array(
        (np.ones(len(pairs)), pairs % count, indptr), shape=(count, count)
    )
    where = np.full(rows.shape, -1)
    where[met] = places
    return pattern, where


def _prolongation(mesh: skfem.MeshTet, free: np.ndarray) -> scipy.sparse.csr_array:
    """From values at the free corners to those at all free nodes, mid-edge nodes included."""
    corners, edges = mesh.p.shape[1], np.asarray(mesh.edges)
    midpoints = corners + np.arange(edges.shape[1])
    rows = np.concatenate([np.arange(corners), midpoints, midpoints])
    columns = np.concatenate([np.arange(corners), *edges])
    values = np.concatenate([np.ones(corners), np.full(2 * len(midpoints), 0.5)])
    return scipy.sparse.csr_array((values, (rows, columns)), shape=(len(free), corners))[free][
        :, free[:corners]
    ]


@numba.njit(cache=True)
@no_type_check
def _add_elastic(residual, data, displacement, elements, places, gradients, weights, first, second):
    """Add the elements' forces and their derivatives; False where an element is
    inverted.
    """
    P, inverse = np.empty((3, 3)), np.empty((3, 3))
    for e in range(len(elements)):
        nodes = elements[e]
        for q in range(weights.shape[1]):
            G = gradients[e, q]
            w = weights[e, q]
            lam = first[e, q]
            mu = second[e, q]
            H = np.zeros((3, 3))
            for a in range(10):
                for i in range(3):
                    for k in range(3):
                        H[i, k] += displacement[nodes[a], i] * G[a, k]
            F = np.eye(3) + H
            det = np.linalg.det(F)
            if det <= 0.0:
                return False
            inverse[:] = np.linalg.inv(F)
            mixed = mu - lam * np.log(det)  # of P = mu F - mixed F^-T
            P[:] = mu * F - mixed * inverse.T
            g = G @ inverse
            for a in range(10):
                for i in range(3):
                    residual[nodes[a], i] += w * (
                        P[i, 0] * G[a, 0] + P[i, 1] * G[a, 1] + P[i, 2] * G[a, 2]
                    )
                for b in range(10):
                    place = places[e, a, b]
                    if place < 0:
                        continue
                    along = w * mu * (G[a, 0] * G[b, 0] + G[a, 1] * G[b, 1] + G[a, 2] * G[b, 2])
                    for i in range(3):
                        data[place, i, i] += along
                        for k in range(3):
                            data[place, i, k] += w * (
                                mixed * g[a, k] * g[b, i] + lam * g[a, i] * g[b, k]
                            )
    return True


@numba.njit(cache=True)
@no_type_check
def _add_contact(
    residual, data, force, displacement, facets, places, shapes, skin, areas, face, X_SP, penalty
):
    """Add the forces of the skin that lies inside the probe, their derivatives, and their sum on
    the probe.
    """
    for f in range(len(facets)):
        nodes = facets[f]
        for q in range(areas.shape[1]):
            N = shapes[f, q]
            x = skin[f, q, 0]
            y = skin[f, q, 1]
            z = skin[f, q, 2]
            for a in range(10):
                x += N[a] * displacement[nodes[a], 0]
                y += N[a] * displacement[nodes[a], 1]
                z += N[a] * displacement[nodes[a], 2]
            px, py, pz = components_P(X_SP, x - X_SP[0, 3], y - X_SP[1, 3], z - X_SP[2, 3])
            gap, gx, gy, gz = distance(face, px, py, pz)
            if gap >= 0:
                continue
            n = X_SP[:3, :3] @ np.array([gx, gy, gz])
            stiffness = penalty * areas[f, q]
            force += stiffness * gap * n
            for a in range(10):
                for i in range(3):
                    residual[nodes[a], i] += stiffness * gap * N[a] * n[i]
                for b in range(10):
                    place = places[f, a, b]
                    if place < 0:
                        continue
                    for i in range(3):
                        for k in range(3):
                            data[place, i, k] += stiffness * N[a] * N[b] * n[i] * n[k]
