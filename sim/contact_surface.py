"""A finer surface for the contact than the finite elements have: half-space theory near, finite elements far.

A load's own neighbourhood gives way as an elastic half-space does, whatever the body's shape: the displacement falls
with the inverse distance, too sharply for the finite elements. What they add, by shape and clamping, is smooth. So
the finite elements' flexibility less the half-space's is interpolated, and the half-space's is put back at the finer
spacing. The force of a probe that slides then hardly ripples, and hardly depends on the finite elements' mesh.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.distance import cdist

from sim.compliance import SkinCompliance
from sim.interpolation import interpolation_matrix, interpolation_weights
from sim.mesh import half_shell
from sim.phantom import Phantom

POINTS = 3000
"""Contact points on the skin: about 3.3 mm apart."""
NEAR = 2.0
"""Pairs closer than this many spacings of the finite elements take the smooth remainder from those just beyond [-]."""
HAT_SECOND_MOMENT = 0.3
"""Mean square distance from the middle of a cone-shaped load, over its radius squared [-]."""
DISC_SECOND_MOMENT = 0.5
"""The same of a uniform load on a disc [-]."""


@dataclass(frozen=True, kw_only=True)
class ContactSurface:
    """Points of the skin that may touch the probe, for a Young's modulus of 1 Pa (flexibility scales as 1/E)."""

    vertices_S: Float[np.ndarray, "n 3"]
    """The points [m]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals."""
    direction: Float[np.ndarray, "n 3"]
    """The points on the unit hemisphere."""
    flexibility: Float[np.ndarray, "n n"]
    """Inward displacement of point i for an inward force of 1 N at point j [m]; symmetric."""
    neighbours: Int[np.ndarray, "n k"]
    """The finite elements' vertices around each point."""
    weights: Float[np.ndarray, "n k"]
    """Weights that interpolate from these vertices to the point."""


def contact_surface(phantom: Phantom, compliance: SkinCompliance, points: int = POINTS) -> ContactSurface:
    """Refine the finite elements' flexibility to about `points` points."""
    spacing = np.sqrt(2 * np.pi / points / (np.sqrt(3) / 2))
    direction = half_shell(spacing, turn=0.5)
    direction = direction[direction[:, 2] > 0]
    vertices_S = phantom.embed(direction)
    neighbours, weights = interpolation_weights(compliance.direction, direction)
    from_elements = interpolation_matrix(neighbours, weights, len(compliance.direction))
    along, across = phantom.tangents(direction)
    areas = np.linalg.norm(np.cross(along, across), axis=1) * 2 * np.pi / points
    softness = (1 - phantom.config.poisson**2) / np.pi
    remainder = from_elements @ (from_elements @ _remainder(compliance, softness)).T
    return ContactSurface(
        vertices_S=vertices_S,
        normals_S=phantom.normal(direction),
        direction=direction,
        flexibility=softness * disc_flexibility(vertices_S, areas) + (remainder + remainder.T) / 2,
        neighbours=neighbours,
        weights=weights,
    )


def _remainder(compliance: SkinCompliance, softness: float) -> Float[np.ndarray, "n n"]:
    """The finite elements' flexibility less the half-space's [m/N], smooth on the diagonal too."""
    distance = cdist(compliance.vertices_S, compliance.vertices_S)
    radii = np.sqrt(3 * compliance.areas / np.pi)  # of cones with the loads' areas
    half_space = _spread_flexibility(distance, HAT_SECOND_MOMENT * radii**2, 3 / radii)
    remainder = compliance.normal_flexibility() - softness * half_space
    spacing = np.sqrt(compliance.areas)
    reach = NEAR * (spacing[:, None] + spacing) / 2
    near = distance < reach
    beyond = ~near & (distance < 1.5 * reach)
    level = np.where(beyond, remainder, 0.0).sum(axis=1) / beyond.sum(axis=1)
    return np.where(near, (level[:, None] + level) / 2, remainder)


def disc_flexibility(vertices_S: Float[np.ndarray, "n 3"], areas: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n n"]:
    """Half-space flexibility of uniform loads on discs, over (1 - nu^2) / (pi E) [1/m]."""
    radii = np.sqrt(areas / np.pi)
    return _spread_flexibility(cdist(vertices_S, vertices_S), DISC_SECOND_MOMENT * radii**2, 2 / radii)


def _spread_flexibility(
    distance: Float[np.ndarray, "n n"], second_moments: Float[np.ndarray, "n"], own: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n n"]:
    """Boussinesq's 1/r for loads spread with `second_moments` [m^2], and `own` [1/m] in each load's middle."""
    np.fill_diagonal(distance, 1.0)
    spread = (second_moments[:, None] + second_moments) / 2
    flexibility = (1 + spread / (4 * distance**2)) / distance
    np.fill_diagonal(flexibility, own)
    np.fill_diagonal(distance, 0.0)
    return flexibility
