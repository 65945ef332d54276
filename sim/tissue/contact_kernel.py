"""Frictionless contact of the probe's face with the skin's vertices, compiled: their gaps, and
the forces they bear.
"""

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from sim.tissue.complementarity import MARGIN, solve_contact
from sim.tissue.contact import with_motion
from sim.wrist.probe_face import components_P, distance

REACH = 0.030
"""Deepest penetration that is sought, far beyond where linear elasticity holds [m]."""
BESIDE = 0.004
"""How far beside the face a vertex may lie and yet come to touch it [m]."""
GAP_TOLERANCE = 1e-9
"""Accuracy of a gap [m]."""
GRAZING, STEEPEST = 0.5, 0.2
"""Cosines between the skin's inward normal and the face's normal: from the first on, a rounded edge
yields ever more in the model, and at the second a vertex cannot touch. So a vertex that slides
off an edge is let go softly [-]."""
GRAZING_LIFT = 0.016
"""How far a vertex yields to the grazing face by then [m]."""
FAR = 1.0
"""Stands for all gaps beyond `MARGIN` that no sliding off an edge explains [m]."""
NEWTON_STEPS = 12
BLOCK = 16
"""Consecutive vertices, which are neighbours, that are left out together where they are far."""
ROUNDING = 1e-9
"""Added to a ball's radius, so that rounding loses no vertex [m]."""


@numba.njit(cache=True)
@no_type_check
def press_skin(
    face,
    X_SP,
    velocity_S,
    material,
    vertices_S,
    normals_S,
    balls_S,
    flexibility,
    neighbours,
    weights,
    element_response_S,
    load,
    first,
    second,
):
    """The force on the probe that moves with `velocity_S` [N], its torque about P [N m], the
    contact's centre [m], depth [m] and vertices.

    `material` holds Young's modulus [Pa], the damping [s/m] and the gel's friction [-]. `load` is
    overwritten with the vertices' loads over Young's modulus [m^2], `first` and `second` hold what
    is kept of the two solutions. Solved twice, because a load also moves the skin sideways, and
    then it meets another part of the face. The sideways motion changes so little in the second
    round that a third would move the force by less than .2 %.
    """
    index = find_near(face, X_SP, vertices_S, balls_S)
    gap = find_gaps(face, X_SP, vertices_S[index], normals_S[index])
    index, gap = index[gap != FAR], gap[gap != FAR]
    points_S, normals_S = vertices_S[index], normals_S[index]
    force = solve_contact(flexibility, index, gap, first)
    load[:] = 0.0
    if force.any():
        points_S += _sideways(normals_S, index, force, neighbours, weights, element_response_S)
        gap = find_gaps(face, X_SP, points_S, normals_S)
        force = solve_contact(flexibility, index, gap, second)
        load[index] = force
    total, torque, centre, depth, count = _resultant(points_S, normals_S, gap, force, X_SP[:, 3])
    young, damping, friction = material
    total, torque = with_motion(
        young * total, young * torque, centre - X_SP[:3, 3], velocity_S, damping, friction
    )
    return total, torque, centre, depth, count


@numba.njit(cache=True)
@no_type_check
def find_near(face, X_SP, vertices_S, balls_S):
    """Indices of the vertices in a box around the face.

    Most of the `balls_S`, which enclose `BLOCK` consecutive vertices each, lie outside of it.
    """
    inner_radius, sine, cosine, half_width, edge_radius = face
    half_chord = inner_radius * sine + edge_radius + BESIDE
    half_elevation = half_width + edge_radius + BESIDE
    lowest = -inner_radius * (1 - cosine) - REACH
    index, count = np.empty(len(vertices_S), np.int64), 0
    for ball in range(len(balls_S)):
        x, y, z = _seen_from(X_SP, balls_S[ball])
        r = balls_S[ball, 3]
        beside = abs(x) >= half_chord + r or abs(y) >= half_elevation + r
        if beside or not lowest - r < z < MARGIN + r:
            continue
        for i in range(BLOCK * ball, min(BLOCK * (ball + 1), len(vertices_S))):
            x, y, z = _seen_from(X_SP, vertices_S[i])
            if abs(x) < half_chord and abs(y) < half_elevation and lowest < z < MARGIN:
                index[count] = i
                count += 1
    return index[:count]


@numba.njit(cache=True)
@no_type_check
def _seen_from(X_SP, p_S):
    """Coordinates in P of a point of S [m]."""
    return components_P(X_SP, p_S[0] - X_SP[0, 3], p_S[1] - X_SP[1, 3], p_S[2] - X_SP[2, 3])


def enclosing_balls(vertices_S: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "b 4"]:
    """Centre and radius of a ball around each `BLOCK` consecutive vertices [m], for `find_near`."""
    blocks = [vertices_S[i : i + BLOCK] for i in range(0, len(vertices_S), BLOCK)]
    centres_S = np.array([block.mean(axis=0) for block in blocks])
    radii = [
        np.linalg.norm(block - centre, axis=1).max() + ROUNDING
        for block, centre in zip(blocks, centres_S, strict=True)
    ]
    return np.column_stack([centres_S, radii])


@numba.njit(cache=True)
@no_type_check
def find_gaps(face, X_SP, points_S, normals_S):
    """Distance of each point along its normal to the face [m]: negative by how far the skin must
    yield.

    It is inf where the normal misses the face, which it may meet once the skin has moved sideways,
    and FAR where the face is out of reach.
    """
    gap = np.empty(len(points_S))
    for k in range(len(points_S)):
        n = normals_S[k]
        x, y, z = _seen_from(X_SP, points_S[k])
        ix, iy, iz = components_P(X_SP, -n[0], -n[1], -n[2])
        gap[k] = -_distance_inwards(face, x, y, z, ix, iy, iz)
    return gap


@numba.njit(cache=True)
@no_type_check
def _distance_inwards(face, x, y, z, ix, iy, iz):
    """How far the point must move along the inward direction to lie on the face [m].

    Newton's method: along a line the distance to a convex solid is convex, so the first step leads
    out of the probe and the others come down on the face and never pass it. A line that misses the
    face returns -inf.
    """
    inward = 0.0
    d, slope = _distance_and_slope(face, x, y, z, ix, iy, iz)
    if slope <= STEEPEST:
        inward = REACH
        d, slope = _distance_and_slope(
            face, x + inward * ix, y + inward * iy, z + inward * iz, ix, iy, iz
        )
    for _ in range(NEWTON_STEPS):
        if slope < STEEPEST:
            break
        inward -= d / slope
        if inward < -MARGIN:
            return -FAR
        if abs(d) < GAP_TOLERANCE:
            grazing = max(GRAZING - slope, 0.0) / (GRAZING - STEEPEST)
            return inward - GRAZING_LIFT * grazing**2
        d, slope = _distance_and_slope(
            face, x + inward * ix, y + inward * iy, z + inward * iz, ix, iy, iz
        )
    return -np.inf


@numba.njit(cache=True)
@no_type_check
def _distance_and_slope(face, x, y, z, ix, iy, iz):
    """Distance of a point from the face [m], and its growth along a direction [-]."""
    d, gx, gy, gz = distance(face, x, y, z)
    return d, gx * ix + gy * iy + gz * iz


@numba.njit(cache=True)
@no_type_check
def displace_skin(normals_S, load, flexibility, neighbours, weights, element_response_S):
    """How far the loads move every vertex [m]: along its normal by the flexibility, across it as
    `_sideways`.
    """
    vertices = np.arange(len(load))
    moved_S = _sideways(normals_S, vertices, load, neighbours, weights, element_response_S)
    inward = np.zeros(len(load), np.float32)  # as exact as the flexibility
    for j in np.nonzero(load)[0]:
        row, pressing = flexibility[j], np.float32(load[j])
        for i in range(len(inward)):
            inward[i] += row[i] * pressing
    for i in range(len(inward)):
        for c in range(3):
            moved_S[i, c] -= inward[i] * normals_S[i, c]
    return moved_S


@numba.njit(cache=True)
@no_type_check
def _sideways(normals_S, index, load, neighbours, weights, element_response_S):
    """How far the loads move the skin across its normals at the vertices `index`, of those normals
    [m].

    The response of the finite elements: [i, j] of `element_response_S` is the displacement of their
    vertex i for a unit load at j. Loads and displacements pass between them and the skin's vertices
    by the `weights` of each one's `neighbours`.
    """
    on_elements = np.zeros(len(element_response_S))
    for k in range(len(index)):
        for a in range(neighbours.shape[1]):
            on_elements[neighbours[index[k], a]] += weights[index[k], a] * load[k]
    loaded = np.nonzero(on_elements)[0]
    displacement, known = (
        np.empty((len(element_response_S), 3)),
        np.zeros(len(element_response_S), np.bool_),
    )
    shift = np.empty((len(index), 3))
    for k in range(len(index)):
        x = 0.0
        y = 0.0
        z = 0.0
        for a in range(neighbours.shape[1]):
            i, weight = neighbours[index[k], a], weights[index[k], a]
            if not known[i]:
                _add_up(displacement[i], element_response_S[i], on_elements, loaded)
                known[i] = True
            x += weight * displacement[i, 0]
            y += weight * displacement[i, 1]
            z += weight * displacement[i, 2]
        along = x * normals_S[k, 0] + y * normals_S[k, 1] + z * normals_S[k, 2]
        shift[k, 0] = x - along * normals_S[k, 0]
        shift[k, 1] = y - along * normals_S[k, 1]
        shift[k, 2] = z - along * normals_S[k, 2]
    return shift


@numba.njit(cache=True)
@no_type_check
def _add_up(total, response, on_elements, loaded):
    """The displacement `total` that all loaded elements' vertices together give to one of them."""
    x = 0.0
    y = 0.0
    z = 0.0
    for j in loaded:
        x += on_elements[j] * response[j, 0]
        y += on_elements[j] * response[j, 1]
        z += on_elements[j] * response[j, 2]
    total[0] = x
    total[1] = y
    total[2] = z


@numba.njit(cache=True)
@no_type_check
def _resultant(points_S, normals_S, gap, force, p_S):
    """Force, torque about `p_S`, centre, depth and number of the contact.

    The reaction to the loads on the tissue: they act along the skin's normals, where the skin meets
    the face.
    """
    total = np.zeros(3)
    torque = np.zeros(3)
    centre = np.zeros(3)
    pressed = 0.0
    depth = 0.0
    count = 0
    for k in range(len(force)):
        if force[k] <= 0:
            continue
        fx = force[k] * normals_S[k, 0]
        fy = force[k] * normals_S[k, 1]
        fz = force[k] * normals_S[k, 2]
        px = points_S[k, 0] + gap[k] * normals_S[k, 0]
        py = points_S[k, 1] + gap[k] * normals_S[k, 1]
        pz = points_S[k, 2] + gap[k] * normals_S[k, 2]
        x = px - p_S[0]
        y = py - p_S[1]
        z = pz - p_S[2]
        total[0] += fx
        total[1] += fy
        total[2] += fz
        torque[0] += y * fz - z * fy
        torque[1] += z * fx - x * fz
        torque[2] += x * fy - y * fx
        centre[0] += force[k] * px
        centre[1] += force[k] * py
        centre[2] += force[k] * pz
        pressed += force[k]
        depth = max(depth, -gap[k])
        count += 1
    for i in range(3):
        centre[i] = centre[i] / pressed if count > 0 else p_S[i]
    return total, torque, centre, depth, count
