"""What a phantom does to the probe that presses it, whatever its mechanics, and the gel between
the two.
"""

import math
from dataclasses import dataclass
from typing import Protocol, no_type_check, runtime_checkable

import numba
import numpy as np
from jaxtyping import Float

FRICTION_SPEED = 2e-3
"""Sliding speed beyond which friction is fully there [m/s]; it keeps the force smooth when the
motion reverses."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """What a press does to the probe, in S."""

    force_S: Float[np.ndarray, "3"]
    """Force of the phantom on the probe [N]."""
    torque_S: Float[np.ndarray, "3"]
    """Its torque about the probe tip P [N m]."""
    depth: float
    """Largest inward displacement of the skin along its normal [m]."""
    vertices: int
    """Points of the skin that touch the probe."""
    centre_S: Float[np.ndarray, "3"]
    """Centre of the contact, weighted by pressure [m]; P itself where nothing touches."""


@dataclass(frozen=True, kw_only=True)
class ContactPatch:
    """Where the probe touches and how hard; one row a touching point, none without contact."""

    points_S: Float[np.ndarray, "n 3"]
    """Places on the deformed skin [m]."""
    pressure: Float[np.ndarray, "n"]
    """Elastic pressure [Pa]."""
    areas: Float[np.ndarray, "n"]
    """Skin that each point stands for [m^2]; pressure times area is its force."""


@runtime_checkable
class Mechanics(Protocol):
    """Contact mechanics of the phantom under the probe. It remembers the last press."""

    def press(self, X_SP: Float[np.ndarray, "4 4"], velocity_S: Float[np.ndarray, "3"]) -> Contact:
        """Press the probe, held at `X_SP` and moving with `velocity_S` [m/s] over the phantom,
        against it.
        """
        ...

    def deformed_skin(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the phantom's fine skin mesh in S after the last press [m]."""
        ...

    def patch(self) -> ContactPatch:
        """Contact patch and pressure of the last press."""
        ...

    def reset(self) -> None:
        """Forget the last press: the skin is undeformed."""
        ...


@numba.njit(cache=True)
@no_type_check
def with_motion(elastic_S, torque_S, arm_S, velocity_S, damping, friction):
    """Force on the probe [N] and torque about its tip [N m], where it moves, from those of the
    elastic contact alone.

    Hunt and Crossley's damping raises the force by the fraction `damping` [s/m] per speed of
    indentation while the probe goes in and lets it fall while it comes out, never below zero: the
    skin does not pull [Hunt]. Coulomb's friction of the gel acts across it, smoothed around rest.
    Both act in the contact's centre, `arm_S` [m] from the tip.
    """
    force, torque = elastic_S.copy(), torque_S.copy()
    magnitude = math.sqrt(elastic_S[0] ** 2 + elastic_S[1] ** 2 + elastic_S[2] ** 2)
    if magnitude == 0.0:
        return force, torque
    away = (
        elastic_S[0] * velocity_S[0] + elastic_S[1] * velocity_S[1] + elastic_S[2] * velocity_S[2]
    ) / magnitude
    added, squared = np.empty(3), FRICTION_SPEED**2
    for i in range(3):
        added[i] = velocity_S[i] - away * elastic_S[i] / magnitude  # the sliding velocity
        squared += added[i] ** 2
    rise, drag = max(-damping * away, -1.0), friction * magnitude / math.sqrt(squared)
    for i in range(3):
        added[i] = rise * elastic_S[i] - drag * added[i]
        force[i] += added[i]
    torque[0] += arm_S[1] * added[2] - arm_S[2] * added[1]
    torque[1] += arm_S[2] * added[0] - arm_S[0] * added[2]
    torque[2] += arm_S[0] * added[1] - arm_S[1] * added[0]
    return force, torque
