"""The compliance of an elastic half-space under a distributed load, and what a body's flexibility
adds to it: a smooth remainder.

A load's own neighbourhood deforms as a half-space does, whatever the body's shape: the
displacement falls with the inverse distance, too sharply for finite elements [Johnson]. What they
add, by shape and clamping, is smooth. Nearest to a load they know nothing of it; there the
remainder is a polynomial through its values all around.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist

from sim.tissue.hemisphere import sphere_axes

NEAR, AROUND = 2.0, 5.0
"""Pairs closer than NEAR spacings of the finite elements take the remainder from those at NEAR to
AROUND [-]."""


@dataclass(frozen=True, kw_only=True)
class Loads:
    """Spread loads on the skin, all of 1 N."""

    areas: Float[np.ndarray, "n"]
    """Force over the pressure at the centre [m^2]."""
    centres_S: Float[np.ndarray, "n 3"]
    """Centres of pressure [m]."""
    moments: Float[np.ndarray, "n"]
    """Mean square distance of the pressure from its centre [m^2]."""


def softness(poisson: float) -> float:
    """Displacement of a half-space's surface [m] times distance [m], for 1 N and a Young's
    modulus of 1 Pa [m^2].
    """
    return (1 - poisson**2) / np.pi


@numba.njit(cache=True)
@no_type_check
def add_discs(flexibility, points_S, areas, softness):
    """Add to `flexibility` [m/N] that of a half-space for uniform loads on discs, in place: it is
    large.

    Args:
        flexibility: Of every point for a load at every other, n x n.
        points_S: Their centres, n x 3 [m].
        areas: Of the discs, n [m^2].
        softness: Of the half-space [m^2].
    """
    for i in range(len(areas)):
        flexibility[i, i] += softness * 2 * math.sqrt(math.pi / areas[i])
        for j in range(i):
            squared = 0.0
            for k in range(3):
                squared += (points_S[i, k] - points_S[j, k]) ** 2
            moment = (areas[i] + areas[j]) / (4 * math.pi)
            value = softness * (1 + moment / (4 * squared)) / math.sqrt(squared)
            flexibility[i, j] += value
            # exactly, whatever rounding made of the sum that came in
            flexibility[j, i] = flexibility[i, j]


def smooth_remainder(
    flexibility: Float[np.ndarray, "n n"],
    points_S: Float[np.ndarray, "n 3"],
    normals_S: Float[np.ndarray, "n 3"],
    loads: Loads,
    poisson: float,
) -> Float[np.ndarray, "n n"]:
    """What the finite elements' flexibility has beyond a half-space's [m/N]; symmetric, smooth on
    the diagonal too.

    Args:
        flexibility: Inward displacement of point i for 1 N of load j, Young's modulus 1 Pa at the
            surface [m/N].
        points_S: Points of the skin [m].
        normals_S: Outward normals there.
        loads: The loads, one around each point.
        poisson: Poisson's ratio of the surface.
    """
    half_space = softness(poisson) * _from_afar(cdist(points_S, loads.centres_S), loads.moments)
    remainder = flexibility - half_space
    remainder = (remainder + remainder.T) / 2
    distance = cdist(points_S, points_S)
    spacing = np.sqrt(loads.areas)
    reach = NEAR * (spacing[:, None] + spacing) / 2
    continued = _continued(remainder, points_S, normals_S, distance, reach)
    return np.where(distance < reach, (continued + continued.T) / 2, remainder)


def _continued(
    remainder: Float[np.ndarray, "n n"],
    points_S: Float[np.ndarray, "n 3"],
    normals_S: Float[np.ndarray, "n 3"],
    distance: Float[np.ndarray, "n n"],
    reach: Float[np.ndarray, "n n"],
) -> Float[np.ndarray, "n n"]:
    """Each point's row of the remainder by a polynomial in its tangent plane, fitted beyond
    `reach` [m/N].
    """
    radius = AROUND / NEAR * reach
    from_point_S = points_S - points_S[:, None]
    s, t = (
        np.einsum("ijc,ic->ij", from_point_S, axis_S) / radius for axis_S in sphere_axes(normals_S)
    )
    squared = (distance / radius) ** 2
    terms = np.stack(
        [np.ones_like(s), s, t, s * s, s * t, t * t, s * squared, t * squared, squared * squared],
        axis=2,
    )
    weights = np.where((distance >= reach) & (squared < 1), (1 - squared) ** 2, 0.0)
    weighted = (weights[:, :, None] * terms).transpose(0, 2, 1)
    coefficients = np.linalg.solve(weighted @ terms, weighted @ remainder[:, :, None])
    return (terms @ coefficients)[:, :, 0]


def _from_afar(
    distance: Float[np.ndarray, "n n"], moments: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n n"]:
    """Boussinesq's 1/r [1/m] for loads spread about their centres with second `moments` [m^2]."""
    return (1 + moments / (4 * distance**2)) / distance
