"""The face of a convex ultrasound probe as an exact signed distance, for contact.

The solid is a sector of a disc (the array's arc), extruded in elevation, with every edge rounded: a
smaller sector, inflated by the edges' radius.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ProbeFace:
    """A convex array with a 60 mm radius (R60) and a field of about 60 degrees; P lies in the
    centre of its face.
    """

    radius: float = 0.060
    """Radius of the array's arc [m]."""
    arc: float = 0.060
    """Length of the arc [m]."""
    elevation: float = 0.013
    """Width of the face across the array [m]."""
    edge_radius: float = 0.003
    """Rounding of all edges [m]."""

    def __post_init__(self) -> None:
        if not 0 < 2 * self.edge_radius <= self.elevation:
            raise ConfigError(
                f"edge_radius must lie in (0, {self.elevation / 2}] m, got {self.edge_radius} m",
                self,
            )
        if not 2 * self.edge_radius < self.arc < math.pi * self.radius:
            raise ConfigError(
                f"arc must lie between twice edge_radius and half a rotation, got {self.arc} m",
                self,
            )

    def parameters(self) -> Float[np.ndarray, "5"]:
        """What `distance` takes: inner sector's radius, sine and cosine of its half angle, half
        width; edge radius.
        """
        half_angle = (self.arc / 2 - self.edge_radius) / self.radius
        half_width = self.elevation / 2 - self.edge_radius
        sine, cosine = math.sin(half_angle), math.cos(half_angle)
        return np.array(
            [self.radius - self.edge_radius, sine, cosine, half_width, self.edge_radius]
        )


@numba.njit(cache=True)
@no_type_check
def components_P(X_SP, x, y, z):
    """Components in basis P of the free vector (x, y, z) of basis S, by a pose or a rotation."""
    return (
        X_SP[0, 0] * x + X_SP[1, 0] * y + X_SP[2, 0] * z,
        X_SP[0, 1] * x + X_SP[1, 1] * y + X_SP[2, 1] * z,
        X_SP[0, 2] * x + X_SP[1, 2] * y + X_SP[2, 2] * z,
    )


@numba.njit(cache=True)
@no_type_check
def distance(face, x, y, z):
    """Signed distance [m] of a point in P to the face's solid, and its gradient.

    Args:
        face: `ProbeFace.parameters()`.
        x: Coordinate along the array [m].
        y: Coordinate in elevation [m].
        z: Coordinate out of the face [m].
    """
    inner_radius, sine, cosine, half_width, edge_radius = face
    side = 1.0 if x >= 0 else -1.0
    across, gx, gz = _sector_distance(
        inner_radius, sine, cosine, abs(x), z + inner_radius + edge_radius
    )
    beyond = abs(y) - half_width
    gy = 1.0 if y >= 0 else -1.0
    if across > 0 and beyond > 0:
        length = math.sqrt(across * across + beyond * beyond)
        a, b = across / length, beyond / length
        return length - edge_radius, a * gx * side, b * gy, a * gz
    if across > beyond:
        return across - edge_radius, gx * side, 0.0, gz
    return beyond - edge_radius, 0.0, gy, 0.0


@numba.njit(cache=True)
@no_type_check
def _sector_distance(radius, sine, cosine, x, z):
    """Signed distance, and its gradient, to a sector around +z with its tip in the origin, for x
    >= 0.
    """
    from_centre = math.sqrt(x * x + z * z)
    aside = x * cosine - z * sine
    if aside <= 0:
        arc = from_centre - radius
        if arc >= aside:
            return arc, x / from_centre, z / from_centre
        return aside, cosine, -sine
    along = min(max(x * sine + z * cosine, 0.0), radius)
    dx, dz = x - along * sine, z - along * cosine
    length = math.sqrt(dx * dx + dz * dz)
    return length, dx / length, dz / length
