"""The soft phantom under the probe: contact force, and the skin as it lies deformed.

Quasi-static and linear elastic: the skin's flexibility, computed once, turns every press into a
small frictionless contact problem between the probe's exact face and points of the skin. Gel
friction and the tissue's damping are laid over the elastic force. Linear theory was held against
large deformations to `LINEAR_LIMIT`; beyond, a warning says so.
"""

import warnings
from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int

from sim.tissue.complementarity import Solved
from sim.tissue.compliance import SkinCompliance
from sim.tissue.compliance_cache import cached_compliance
from sim.tissue.contact import Contact, ContactPatch
from sim.tissue.contact_kernel import displace_skin, press_skin
from sim.tissue.contact_surface import contact_surface
from sim.tissue.interpolation import interpolation_matrix, interpolation_weights
from sim.tissue.phantom import Phantom
from sim.wrist.probe_face import ProbeFace

SKIN_POINTS = 400
"""Vertices of the finite elements on the skin: 9 mm apart. Twice as many change the force by 1.2 %
at the most."""
MAX_TOUCHING = 512
"""Contact points that the probe may touch: several times what it can cover."""
LINEAR_LIMIT = 0.008
"""Indentation to which linear elasticity was validated [m]."""
DAMPING = 3.0
"""Relative rise of the elastic force per speed of indentation [s/m] (Hunt and Crossley): 15 N s/m
at 5 N."""


class SoftTissue:
    """The elastic phantom. It remembers the last press: as a first guess, and to show the
    deformed skin.
    """

    def __init__(
        self, phantom: Phantom, compliance: SkinCompliance, face: ProbeFace | None = None
    ) -> None:
        self._phantom = phantom
        self._surface = contact_surface(phantom, compliance)
        self._face = (face or ProbeFace()).parameters()
        self._material = (phantom.config.young, DAMPING, phantom.config.gel_friction)
        self._element_response_S = np.ascontiguousarray(compliance.response_S.transpose(1, 0, 2))
        self._load = np.zeros(len(self._surface.vertices_S))
        """Inward force on each contact point over Young's modulus [m^2]."""
        self._solved = _unsolved(len(self._load))
        self._warned = False

    @staticmethod
    def build(
        phantom: Phantom, progress: Callable[[float, str], None] | None = None
    ) -> "SoftTissue":
        """Compute the tissue's compliance, or load it where it was computed before.

        Args:
            phantom: Shape and elasticity.
            progress: Told the fraction done (0 to 1) and what is being done.
        """
        return SoftTissue(phantom, cached_compliance(phantom, SKIN_POINTS, progress))

    def press(self, X_SP: Float[np.ndarray, "4 4"], velocity_S: Float[np.ndarray, "3"]) -> Contact:
        """Press the probe, held at `X_SP` and moving with `velocity_S` [m/s] over the phantom,
        into the tissue.
        """
        # one memory layout, one compiled kernel
        X_SP, velocity_S = np.ascontiguousarray(X_SP), np.ascontiguousarray(velocity_S)
        surface = self._surface
        force_S, torque_S, centre_S, depth, vertices = press_skin(
            self._face,
            X_SP,
            velocity_S,
            self._material,
            surface.vertices_S,
            surface.normals_S,
            surface.balls_S,
            surface.flexibility,
            surface.neighbours,
            surface.weights,
            self._element_response_S,
            self._load,
            *self._solved,
        )
        if depth > LINEAR_LIMIT and not self._warned:
            self._warn(depth)
        return Contact(
            force_S=force_S, torque_S=torque_S, depth=depth, vertices=vertices, centre_S=centre_S
        )

    def _warn(self, depth: float) -> None:
        self._warned = True
        warnings.warn(
            f"the skin is indented by {depth * 1e3:.1f} mm; the tissue's linear elasticity was "
            f"validated to {LINEAR_LIMIT * 1e3:.0f} mm, and beyond it forces come out too small: "
            "press less (--contact.force), or stiffen the phantom (--scene.phantom.young)",
            stacklevel=3,
        )

    def patch(self) -> ContactPatch:
        """Contact patch and pressure of the last press."""
        touching = self.touched
        areas = self._surface.areas[touching]
        return ContactPatch(
            points_S=self._surface.vertices_S[touching] + self._displacement()[touching],
            pressure=self._phantom.config.young * self._load[touching] / areas,
            areas=areas,
        )

    @property
    def skin_points_S(self) -> Float[np.ndarray, "n 3"]:
        """Points of the undeformed skin that may touch the probe [m]."""
        return self._surface.vertices_S

    @property
    def skin_areas(self) -> Float[np.ndarray, "n"]:
        """Skin that each of them stands for [m^2]."""
        return self._surface.areas

    @property
    def touched(self) -> Int[np.ndarray, "k"]:
        """Which of them touch it since the last press."""
        return np.flatnonzero(self._load)

    def deformed_skin(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the phantom's fine skin mesh in S after the last press [m]."""
        return self._phantom.skin.vertices_S + self._to_skin @ self._displacement()

    def reset(self) -> None:
        """Forget the last press: the skin is undeformed."""
        self._load[:] = 0.0
        self._solved = _unsolved(len(self._load))

    def _displacement(self) -> Float[np.ndarray, "n 3"]:
        """Displacement in S of the contact points [m]: along the normal the contact's, across it
        the elements'.
        """
        surface = self._surface
        return displace_skin(
            surface.normals_S, self._load, surface.flexibility, surface.neighbours,
            surface.weights, self._element_response_S,
        )  # fmt: skip

    @cached_property
    def _to_skin(self) -> scipy.sparse.csr_array:
        """Interpolation from the contact points to the fine mesh; its border stays clamped."""
        skin_S, points = self._phantom.skin.vertices_S, len(self._load)
        azimuth = np.linspace(0, 2 * np.pi, 140, endpoint=False)
        clamped = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
        sources = np.concatenate([self._surface.direction, clamped])
        direction = self._phantom.inverse_map(skin_S)
        near, weights = interpolation_weights(sources, direction)
        weights[(near >= points) | (direction[:, 2:] == 0)] = 0.0
        return interpolation_matrix(near, weights, len(sources))[:, :points]


def _unsolved(points: int) -> list[Solved]:
    """What `press_skin` keeps, before the first press."""
    return [Solved.nothing(points, MAX_TOUCHING) for _ in range(2)]
