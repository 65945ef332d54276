"""The map from the unit half-ball to the breast and back, compiled: one formula for points in bulk
and one by one.

`parameters` holds, in this order: the radii along x and y [m], the quadrants' surplus along x and y
[-], the lean linear in the height along x and y [-], the lean quadratic in it [1/m], the dome's
height [m], the nipple's [m], the roundness [-], of nipple and areola the rises [m] and the
widths on the half-ball [-], and the chest's curvature across x [1/m]: the whole is sheared along z
so that its base lies on the chest.
"""

import math
from typing import no_type_check

import numba
import numpy as np


@numba.njit(cache=True)
@no_type_check
def embed_point(parameters, x, y, z):
    """A point of the unit half-ball z >= 0 mapped into the breast, in S [m]; points at distance
    1 become the skin.
    """
    rx, ry, qx, qy, lx, ly, kx, ky, dome_height, _, _, _, _, _, _, curvature = parameters
    height = dome_height * z + _bump(parameters, x, y) * z * z
    flank = _flank(parameters, height)
    across = ry * y * (1 + qy * y) * flank + ly * height + ky * height * height
    return (
        rx * x * (1 + qx * x) * flank + lx * height + kx * height * height,
        across,
        height - curvature * across * across / 2,
    )


@numba.njit(cache=True)
@no_type_check
def inverse_map_point(parameters, x, y, z):
    """Inverse of `embed_point`, extended smoothly around the breast."""
    rx, ry, qx, qy, lx, ly, kx, ky, dome_height, _, _, _, _, _, _, curvature = parameters
    z += curvature * y * y / 2
    flank = _flank(parameters, z)
    bx = _root((x - lx * z - kx * z * z) / (rx * flank), 1.0, qx)
    by = _root((y - ly * z - ky * z * z) / (ry * flank), 1.0, qy)
    return bx, by, _root(z, dome_height, _bump(parameters, bx, by))


@numba.njit(cache=True)
@no_type_check
def embed(parameters, ball):
    """`embed_point` of every row."""
    p_S = np.empty_like(ball)
    for i in range(len(ball)):
        p_S[i, 0], p_S[i, 1], p_S[i, 2] = embed_point(
            parameters, ball[i, 0], ball[i, 1], ball[i, 2]
        )
    return p_S


@numba.njit(cache=True)
@no_type_check
def inverse_map(parameters, p_S):
    """`inverse_map_point` of every row."""
    ball = np.empty_like(p_S)
    for i in range(len(p_S)):
        ball[i, 0], ball[i, 1], ball[i, 2] = inverse_map_point(
            parameters, p_S[i, 0], p_S[i, 1], p_S[i, 2]
        )
    return ball


@numba.njit(cache=True)
@no_type_check
def _bump(parameters, x, y):
    """Rise of nipple and areola [m] over a point of the half-ball's base disc."""
    squared = x * x + y * y
    nipple = parameters[11]
    areola = parameters[12]
    nipple_width = parameters[13]
    areola_width = parameters[14]
    return nipple * math.exp(-squared / nipple_width**2) + areola * math.exp(
        -squared / areola_width**2
    )


@numba.njit(cache=True)
@no_type_check
def _flank(parameters, height):
    """Radius of a level over the half-ellipsoid's [-]: (1 - t)(1 + k t) in place of (1 - t)(1 +
    t), rooted.
    """
    t = max(height / parameters[9], -0.5)  # anything smooth will do below the chest plate
    return math.sqrt((1 + parameters[10] * t) / (1 + t))


@numba.njit(cache=True)
@no_type_check
def _root(value, linear, square):
    """The root t next to 0 of `linear t + square t^2 = value`, where `square` may vanish."""
    discriminant = max(linear * linear + 4 * square * value, 0.0)
    return 2 * value / (linear + math.sqrt(discriminant))
