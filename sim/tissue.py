"""The soft phantom under the probe: contact force, and the skin as it lies deformed.

Quasi-static and linear elastic: the skin's flexibility, computed once, answers every press by a small frictionless
contact problem between the probe's exact face and points of the skin. Linear theory is good to about 8 mm of
indentation; `Contact.depth` lets the caller see when it is left. Gel friction and the tissue's damping are laid
over the elastic force.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse
from jaxtyping import Float

from sim.compliance import SkinCompliance
from sim.compliance_cache import cached_compliance
from sim.contact_kernel import press_skin, resultant
from sim.contact_surface import contact_surface
from sim.interpolation import interpolation_matrix, interpolation_weights
from sim.phantom import Phantom
from sim.probe_face import ProbeFace

SKIN_POINTS = 800
"""Vertices of the finite elements on the skin: 6 mm apart. Twice as many change the force by 1 %."""
GEL_FRICTION = 0.1
"""Friction coefficient of gel on skin [-]; .05 to .2 are plausible."""
FRICTION_SPEED = 2e-3
"""Sliding speed beyond which friction is fully there [m/s]; it keeps the force smooth when the motion turns."""
DAMPING = 3.0
"""Relative rise of the elastic force per speed of indentation [s/m] (Hunt and Crossley): 15 N s/m at 5 N."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """What a press does to the probe, in S."""

    force_S: Float[np.ndarray, "3"]
    """Force of the tissue on the probe [N]."""
    torque_S: Float[np.ndarray, "3"]
    """Its torque about the probe tip P [N m]."""
    depth: float
    """Largest inward displacement of the skin along its normal [m]."""
    vertices: int
    """Points of the skin that touch the probe; they are about 3 mm apart."""
    centre_S: Float[np.ndarray, "3"]
    """Middle of the contact, weighted by pressure [m]; P itself where nothing touches."""


class SoftTissue:
    """The elastic phantom. It remembers the last press: as a first guess, and to show the deformed skin."""

    def __init__(self, phantom: Phantom, compliance: SkinCompliance, face: ProbeFace | None = None) -> None:
        self._phantom = phantom
        self._compliance = compliance
        self._surface = contact_surface(phantom, compliance)
        self._face = (face or ProbeFace()).numbers()
        self._element_response_S = np.ascontiguousarray(compliance.response_S.transpose(1, 0, 2))
        self._load = np.zeros(len(self._surface.vertices_S))
        """Inward force on each contact point over Young's modulus [m^2]."""

    @staticmethod
    def build(
        phantom: Phantom, progress: Callable[[float, str], None] | None = None, *, skin_points: int = SKIN_POINTS
    ) -> "SoftTissue":
        """Compute the tissue's compliance, or load it where it was computed before.

        Args:
            phantom: Shape and elasticity.
            progress: Told the share done (0 to 1) and what is being done.
            skin_points: About how many finite-element vertices to put on the skin.
        """
        return SoftTissue(phantom, cached_compliance(phantom, skin_points, progress))

    def press(self, X_SP: Float[np.ndarray, "4 4"], velocity_S: Float[np.ndarray, "3"]) -> Contact:
        """Press the probe, held at `X_SP` and moving with `velocity_S` [m/s] over the phantom, into the tissue."""
        X_SP, surface = np.ascontiguousarray(X_SP), self._surface  # one memory layout, one compiled kernel
        index, points_S, depth, load = press_skin(
            self._face, X_SP, surface.vertices_S, surface.normals_S, surface.flexibility,
            surface.neighbours, surface.weights, self._element_response_S, self._load,
        )  # fmt: skip
        self._load[:] = 0.0
        self._load[index] = load
        p_S = X_SP[:3, 3]
        if len(index) == 0:
            return Contact(force_S=np.zeros(3), torque_S=np.zeros(3), depth=0.0, vertices=0, centre_S=p_S.copy())
        force = self._phantom.config.young * load
        force_S, torque_S, centre_S = resultant(points_S, surface.normals_S[index], force, p_S)
        added_S = _damping(force_S, velocity_S) + _friction(force_S, velocity_S)
        return Contact(
            force_S=force_S + added_S,
            torque_S=torque_S + np.cross(centre_S - p_S, added_S),
            depth=float(depth.max()),
            vertices=len(index),
            centre_S=centre_S,
        )

    def deformed_skin(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the phantom's fine skin mesh in S after the last press [m]."""
        return self._phantom.skin.vertices_S + self._to_skin @ self._displacement()

    def reset(self) -> None:
        """Forget the last press: the skin is undeformed."""
        self._load[:] = 0.0

    def _displacement(self) -> Float[np.ndarray, "n 3"]:
        """Displacement in S of the contact points [m]: along the normal the contact's, across it the elements'."""
        surface = self._surface
        loaded = np.nonzero(self._load)[0]
        on_elements = (self._from_elements.T @ self._load).astype(np.float32)  # no copy of the response
        across_S = self._from_elements @ np.tensordot(on_elements, self._compliance.response_S, axes=1)
        inward = self._load[loaded] @ surface.flexibility[loaded]
        along = inward + np.einsum("nc,nc->n", across_S, surface.normals_S)
        return across_S - along[:, None] * surface.normals_S

    @cached_property
    def _from_elements(self) -> scipy.sparse.csr_array:
        """Interpolation from the finite elements' vertices to the contact points."""
        surface = self._surface
        return interpolation_matrix(surface.neighbours, surface.weights, len(self._compliance.areas))

    @cached_property
    def _to_skin(self) -> scipy.sparse.csr_array:
        """Interpolation from the contact points to the fine mesh; its border stays clamped."""
        skin_S, points = self._phantom.skin.vertices_S, len(self._load)
        azimuth = np.linspace(0, 2 * np.pi, 140, endpoint=False)
        clamped = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
        sources = np.concatenate([self._surface.direction, clamped])
        near, weights = interpolation_weights(sources, self._phantom.unembed(skin_S))
        weights[(near >= points) | (skin_S[:, 2:] == 0)] = 0.0
        return interpolation_matrix(near, weights, len(sources))[:, :points]


def _damping(elastic_S: Float[np.ndarray, "3"], velocity_S: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Rise of the elastic force while the probe goes in, fall while it comes out; the tissue never pulls."""
    speed_in = -float(elastic_S @ velocity_S) / float(np.linalg.norm(elastic_S))
    return elastic_S * max(DAMPING * speed_in, -1.0)


def _friction(elastic_S: Float[np.ndarray, "3"], velocity_S: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Coulomb's friction of the gel against sliding, smoothed around rest."""
    magnitude = np.linalg.norm(elastic_S)
    normal_S = elastic_S / magnitude
    sliding_S = velocity_S - (velocity_S @ normal_S) * normal_S
    return -GEL_FRICTION * magnitude * sliding_S / np.hypot(np.linalg.norm(sliding_S), FRICTION_SPEED)
