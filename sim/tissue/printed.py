"""The printed phantom, as the paper scans one: the skin is rigid, and only the silicone over the
probe's array yields.

One smooth surface meets another, so the contact is Hertz's: its force follows the depth to which
the two overlap, at the point of the skin that lies deepest in the face [Johnson].
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from sim.tissue import dome
from sim.tissue.contact import Contact, ContactPatch, with_motion
from sim.tissue.hemisphere import hemisphere
from sim.tissue.phantom import Phantom
from sim.wrist.probe_face import ProbeFace, components_P, distance

LENS_YOUNG, LENS_POISSON = 2e6, 0.49
"""Silicone of Shore A 40, as acoustic lenses are made of [Pa], [-]; an engineering value."""
CURVATURE_RADIUS = 0.03
"""Of the gap between face and skin: 1 / (1 / 60 mm + 1 / 60 mm), for the face's arc and the flank
of a breast [m]."""
STIFFNESS = 4 / 3 * LENS_YOUNG / (1 - LENS_POISSON**2) * math.sqrt(CURVATURE_RADIUS)
"""Force over overlap^1.5 [N/m^1.5]: 5 N at .4 mm, where 1 N more takes 50 um."""
DAMPING = 10.0
"""Relative rise of the elastic force per speed of indentation [s/m] (Hunt and Crossley):
rubber's."""
JUMP = 0.01
"""A probe that has moved farther since the last press is sought all over the skin [m]."""
COARSE_RINGS = 24
"""Rings of the points among which it is sought: 4 mm apart."""
STEP = 1e-3
"""Step of the differences on the unit hemisphere [-]."""
LONGEST_STEP = 0.1
"""Longest step of the search on the unit hemisphere [-]."""
SEARCH_STEPS, CLOSE = 30, 1e-8
"""The search ends after so many steps, or when one is shorter than this [-]."""


class PrintedBreast:
    """The rigid phantom. It remembers where the probe last was, to look there first."""

    def __init__(self, phantom: Phantom, face: ProbeFace | None = None) -> None:
        self._phantom = phantom
        self._face = (face or ProbeFace()).parameters()
        self._coarse = hemisphere(COARSE_RINGS)[0]
        self._direction = self._coarse[0]
        self._last_p_S = np.full(3, np.inf)
        self._overlap, self._force = 0.0, 0.0

    def press(self, X_SP: Float[np.ndarray, "4 4"], velocity_S: Float[np.ndarray, "3"]) -> Contact:
        """Press the probe, held at `X_SP` and moving with `velocity_S` [m/s] over the phantom,
        against it.
        """
        X_SP, parameters = np.ascontiguousarray(X_SP), self._phantom.parameters
        p_S = X_SP[:3, 3]
        if not np.abs(p_S - self._last_p_S).max() < JUMP:
            self._direction = _deepest_of(parameters, self._face, X_SP, self._coarse)
        self._last_p_S = p_S.copy()
        self._direction, gap, outward_S = deepest_point(
            parameters, self._face, X_SP, self._direction
        )
        self._overlap = max(-gap, 0.0)
        self._force = STIFFNESS * self._overlap**1.5
        centre_S = self._phantom.embed(self._direction)
        arm_S = centre_S - p_S
        elastic_S = -self._force * outward_S
        force_S, torque_S = with_motion(
            elastic_S, np.cross(arm_S, elastic_S), arm_S, np.ascontiguousarray(velocity_S), DAMPING,
            self._phantom.config.gel_friction,
        )  # fmt: skip
        touching = self._overlap > 0
        return Contact(
            force_S=force_S,
            torque_S=torque_S,
            depth=0.0,
            vertices=int(touching),
            centre_S=centre_S if touching else p_S.copy(),
        )

    def deformed_skin(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the phantom's fine skin mesh in S [m]; a print keeps its shape."""
        return self._phantom.skin.vertices_S

    def patch(self) -> ContactPatch:
        """The last press as one point, with the area of Hertz's circle."""
        touching = self._overlap > 0
        areas = np.array([math.pi * CURVATURE_RADIUS * self._overlap] if touching else [])
        points_S = self._phantom.embed(self._direction)[None] if touching else np.zeros((0, 3))
        return ContactPatch(points_S=points_S, pressure=self._force / areas, areas=areas)

    def reset(self) -> None:
        """Forget the last press."""
        self._last_p_S[:] = np.inf
        self._overlap, self._force = 0.0, 0.0


@numba.njit(cache=True)
@no_type_check
def deepest_point(parameters, face, X_SP, direction):
    """The point of the skin deepest in the face, or nearest to it: on the hemisphere, its gap [m],
    the face's normal.

    Newton's method from `direction`, a point of the unit hemisphere, on the distance of the skin
    from the face.
    """
    gap = _gap(parameters, face, X_SP, direction)
    for _ in range(SEARCH_STEPS):
        x, y, z = direction
        a = -1 / (1 + z)
        u, v = np.array([1 + x * x * a, x * y * a, -x]), np.array([x * y * a, 1 + y * y * a, -y])
        step = _newton_step(parameters, face, X_SP, direction, u, v, gap)
        fraction = min(1.0, LONGEST_STEP / max(math.hypot(step[0], step[1]), 1e-300))
        while True:
            moved = direction + fraction * (step[0] * u + step[1] * v)
            moved[2] = max(moved[2], 0.0)
            moved /= np.linalg.norm(moved)
            gap_there = _gap(parameters, face, X_SP, moved)
            if gap_there <= gap or fraction < 1e-3:
                break
            fraction /= 2
        if gap_there > gap:
            break
        done = np.abs(moved - direction).max() < CLOSE
        direction, gap = moved, gap_there
        if done:
            break
    p = _on_face(parameters, X_SP, direction)
    _, gx, gy, gz = distance(face, p[0], p[1], p[2])
    outward = X_SP[:3, 0] * gx + X_SP[:3, 1] * gy + X_SP[:3, 2] * gz
    return direction, gap, outward


@numba.njit(cache=True)
@no_type_check
def _newton_step(parameters, face, X_SP, direction, u, v, gap):
    """Step along the tangents u and v to where the gap is smallest, downhill at any rate."""
    right, left = (
        _gap(parameters, face, X_SP, direction + STEP * u),
        _gap(parameters, face, X_SP, direction - STEP * u),
    )
    up, down = (
        _gap(parameters, face, X_SP, direction + STEP * v),
        _gap(parameters, face, X_SP, direction - STEP * v),
    )
    both, neither = (
        _gap(parameters, face, X_SP, direction + STEP * (u + v)),
        _gap(parameters, face, X_SP, direction - STEP * (u + v)),
    )
    du, dv = (right - left) / (2 * STEP), (up - down) / (2 * STEP)
    uu, vv = (right - 2 * gap + left) / STEP**2, (up - 2 * gap + down) / STEP**2
    uv = ((both - 2 * gap + neither) / STEP**2 - uu - vv) / 2
    determinant = uu * vv - uv * uv
    if uu > 0 and determinant > 0:
        return (-(vv * du - uv * dv) / determinant, -(uu * dv - uv * du) / determinant)
    scale = LONGEST_STEP / max(math.hypot(du, dv), 1e-300)
    return (-scale * du, -scale * dv)


@numba.njit(cache=True)
@no_type_check
def _gap(parameters, face, X_SP, direction):
    """Distance of a point of the skin from the face [m], negative inside."""
    p = _on_face(parameters, X_SP, direction)
    return distance(face, p[0], p[1], p[2])[0]


@numba.njit(cache=True)
@no_type_check
def _on_face(parameters, X_SP, direction):
    """A point of the skin in P [m]."""
    length = math.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    x, y, z = dome.embed_point(
        parameters, direction[0] / length, direction[1] / length, direction[2] / length
    )
    return components_P(X_SP, x - X_SP[0, 3], y - X_SP[1, 3], z - X_SP[2, 3])


@numba.njit(cache=True)
@no_type_check
def _deepest_of(parameters, face, X_SP, directions):
    """The one of these points of the hemisphere that is deepest in the face."""
    best, smallest = 0, np.inf
    for i in range(len(directions)):
        gap = _gap(parameters, face, X_SP, directions[i])
        if gap < smallest:
            best, smallest = i, gap
    return directions[best].copy()
