"""A finer surface for the contact than the finite elements have: half-space theory near, finite
elements far.

The finite elements' smooth remainder is interpolated, and the half-space's flexibility put back at
the finer spacing. The force of a probe that slides then hardly ripples, and hardly depends on the
finite elements' mesh: with 400 vertices on the skin it is within 2.1 % of 1600's.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial import KDTree

from breastscan.tissue.mesh import half_shell
from sim.tissue import half_space
from sim.tissue.compliance import SkinCompliance
from sim.tissue.contact_kernel import enclosing_balls
from sim.tissue.interpolation import interpolation_matrix, interpolation_weights
from sim.tissue.phantom import Phantom

SPACING = 0.0023
"""Distance of the contact points [m], where the base lies; on top, which is nearer to the centre,
it is 1.9 mm. Where a row of points lies along an edge of the probe's face, a slide ripples most: by
.024 N RMS at 5 N, and by .011 N over all ways to hold the probe (twice the distance: .09 and .03
N)."""
FINEST = 0.029
"""Distance on the half-ball that is not gone below [-]: a large breast would have too many
points."""


@dataclass(frozen=True, kw_only=True)
class ContactSurface:
    """Points of the skin that may touch the probe, for a Young's modulus of 1 Pa (flexibility
    scales as 1/E).
    """

    vertices_S: Float[np.ndarray, "n 3"]
    """The points [m]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals."""
    areas: Float[np.ndarray, "n"]
    """Skin that each point stands for [m^2]."""
    balls_S: Float[np.ndarray, "b 4"]
    """Balls around consecutive points, as `contact_kernel.find_near` takes them [m]."""
    direction: Float[np.ndarray, "n 3"]
    """The points on the unit hemisphere."""
    flexibility: Float32[np.ndarray, "n n"]
    """Inward displacement of point i for an inward force of 1 N at point j [m]; symmetric."""
    neighbours: Int[np.ndarray, "n k"]
    """The finite elements' vertices around each point."""
    weights: Float[np.ndarray, "n k"]
    """Weights that interpolate from these vertices to the point."""


def contact_surface(phantom: Phantom, compliance: SkinCompliance) -> ContactSurface:
    """Refine the finite elements' flexibility to points about `SPACING` apart."""
    spacing = max(SPACING / phantom.radius, FINEST)
    direction = half_shell(spacing, rotation=0.5)
    direction = direction[direction[:, 2] > 0]
    # neighbours lie together in memory: half the time of a press
    direction = direction[KDTree(direction).indices]
    vertices_S = phantom.embed(direction)
    along_S, across_S = phantom.tangents(direction)
    areas = np.linalg.norm(np.cross(along_S, across_S), axis=1) * np.sqrt(3) / 2 * spacing**2
    neighbours, weights = interpolation_weights(compliance.direction, direction)
    from_elements = interpolation_matrix(
        neighbours, weights.astype(np.float32), len(compliance.direction)
    )
    flexibility = from_elements @ (from_elements @ compliance.remainder.astype(np.float32)).T
    half_space.add_discs(
        flexibility, vertices_S, areas, half_space.softness(phantom.config.poisson)
    )
    return ContactSurface(
        vertices_S=vertices_S,
        normals_S=phantom.normal(direction),
        areas=areas,
        balls_S=enclosing_balls(vertices_S),
        direction=direction,
        flexibility=flexibility,
        neighbours=neighbours,
        weights=weights,
    )
