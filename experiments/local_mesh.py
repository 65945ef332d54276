"""A tetrahedral mesh of the phantom that is fine under the probe and coarse elsewhere, for
reference solutions.
"""

import logging

import numpy as np
import skfem
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.tissue.mesh import mesh_breast
from sim.tissue.phantom import Phantom

COARSE_POINTS = 400
"""Points on the skin before refinement."""
GROWTH = 0.6
"""Longest edge that is let be, over the distance from the face, beyond the finest one [-]."""
HALF_FACE = (0.030, 0.0065)
"""Half lengths of the probe's face along and across the array [m]."""
ROUNDS = 12


def local_mesh(phantom: Phantom, X_SP: Float[np.ndarray, "4 4"], finest: float) -> skfem.MeshTet:
    """Bisect the phantom's tetrahedra until no edge at the probe's face is longer than `finest`
    [m].

    New points on the skin are put on the smooth surface, so the shape converges with the mesh.
    """
    # it tells of every copy that refining makes
    logging.getLogger("skfem.mesh.mesh").setLevel(logging.ERROR)
    coarse = mesh_breast(phantom.embed, COARSE_POINTS)
    mesh = skfem.MeshTet(
        np.ascontiguousarray(coarse.direction.T), np.ascontiguousarray(coarse.tetrahedra.T)
    )
    X_PS = se3.inverse(X_SP)
    for _ in range(ROUNDS):
        _onto_sphere(mesh)
        corners_P = se3.transform(X_PS, phantom.embed(mesh.p.T))[mesh.t]
        edges = [
            np.linalg.norm(corners_P[i] - corners_P[j], axis=1) for i in range(4) for j in range(i)
        ]
        too_long = np.max(edges, axis=0) > finest + GROWTH * _from_face(corners_P.mean(axis=0))
        if not too_long.any():
            break
        mesh = mesh.refined(np.flatnonzero(too_long))
    _onto_sphere(mesh)
    return skfem.MeshTet(
        np.ascontiguousarray(phantom.embed(mesh.p.T).T), np.ascontiguousarray(mesh.t)
    )


def _from_face(p_P: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Distance [m] from a box that reaches from behind the probe to its face."""
    beyond = np.maximum(np.abs(p_P[:, :2]) - HALF_FACE, 0.0)
    return np.linalg.norm(np.column_stack([beyond, np.maximum(p_P[:, 2], 0.0)]), axis=1)


def _onto_sphere(mesh: skfem.MeshTet) -> None:
    """Put what lies on the skin of the half-ball, in place, at distance 1 from its centre."""
    facets = np.asarray(mesh.facets)[:, mesh.boundary_facets()]
    skin = np.unique(facets[:, (mesh.p[2][facets] > 1e-12).any(axis=0)])
    mesh.p[:, skin] /= np.linalg.norm(mesh.p[:, skin], axis=0)
