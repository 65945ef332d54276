"""The first triangle that each ray of a camera meets: rasterised, then solved exactly on the
triangles' planes.
"""

from typing import no_type_check

import numba
import numpy as np

CELLS = 256
"""Cells across the picture of the triangles into which they are sorted."""
INSIDE = -1e-9
"""Barycentric coordinate from which a ray belongs to a triangle: rays along an edge belong to both
[-]."""


@numba.njit(cache=True)
@no_type_check
def first_hits(corners_C, rays_C):
    """Depth z of the first triangle on each ray, the triangle, and the ray's barycentric
    coordinates on it.

    Args:
        corners_C: [m, 3, 3] triangles' corners in the camera's frame, all in front of it [m].
        rays_C: [n, 3] directions with z = 1; NaN for none.

    Returns:
        Depth [n] [m], NaN where no triangle is met; index [n], -1 there; coordinates [n, 3].
    """
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for t in range(len(corners_C)):
        for a in range(3):
            for k in range(2):
                image = corners_C[t, a, k] / corners_C[t, a, 2]
                low[k], high[k] = min(low[k], image), max(high[k], image)
    scale = CELLS / (high - low + 1e-12)
    first, members = _sorted(corners_C, low, scale)
    depth, hit = np.full(len(rays_C), np.nan), np.full(len(rays_C), -1)
    weights = np.zeros((len(rays_C), 3))
    for i in range(len(rays_C)):
        x, y = rays_C[i, 0], rays_C[i, 1]
        if not (low[0] <= x <= high[0] and low[1] <= y <= high[1]):
            continue
        cell = CELLS * min(int((y - low[1]) * scale[1]), CELLS - 1) + min(
            int((x - low[0]) * scale[0]), CELLS - 1
        )
        for place in range(first[cell], first[cell + 1]):
            t = members[place]
            z, a, b, c = _meet(corners_C[t], x, y)
            if min(a, b, c) >= INSIDE and not z >= depth[i]:
                depth[i], hit[i] = z, t
                weights[i, 0] = a
                weights[i, 1] = b
                weights[i, 2] = c
    return depth, hit, weights


@numba.njit(cache=True)
@no_type_check
def _sorted(corners_C, low, scale):
    """The triangles by the cells that their bounding boxes cover: where each cell's start, and
    all of them in turn.
    """
    boxes = np.empty((len(corners_C), 4), np.int64)
    first = np.zeros(CELLS * CELLS + 1, np.int64)
    for t in range(len(corners_C)):
        for k in range(2):
            image = (corners_C[t, :, k] / corners_C[t, :, 2] - low[k]) * scale[k]
            boxes[t, k], boxes[t, 2 + k] = int(image.min()), min(int(image.max()), CELLS - 1)
        for row in range(boxes[t, 1], boxes[t, 3] + 1):
            for column in range(boxes[t, 0], boxes[t, 2] + 1):
                first[CELLS * row + column + 1] += 1
    first = np.cumsum(first)
    members, filled = np.empty(first[-1], np.int64), first[:-1].copy()
    for t in range(len(corners_C)):
        for row in range(boxes[t, 1], boxes[t, 3] + 1):
            for column in range(boxes[t, 0], boxes[t, 2] + 1):
                members[filled[CELLS * row + column]] = t
                filled[CELLS * row + column] += 1
    return first, members


@numba.njit(cache=True)
@no_type_check
def _meet(corners, x, y):
    """Depth at which the ray (x, y, 1) meets a triangle's plane, and its barycentric coordinates
    there.
    """
    ax = corners[0, 0]
    ay = corners[0, 1]
    az = corners[0, 2]
    ux = corners[1, 0] - ax
    uy = corners[1, 1] - ay
    uz = corners[1, 2] - az
    vx = corners[2, 0] - ax
    vy = corners[2, 1] - ay
    vz = corners[2, 2] - az
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    slope = nx * x + ny * y + nz
    if slope == 0.0:
        return np.nan, -1.0, -1.0, -1.0
    z = (nx * ax + ny * ay + nz * az) / slope
    px = z * x - ax
    py = z * y - ay
    pz = z - az
    squared = nx * nx + ny * ny + nz * nz
    b = (nx * (py * vz - pz * vy) + ny * (pz * vx - px * vz) + nz * (px * vy - py * vx)) / squared
    c = (nx * (uy * pz - uz * py) + ny * (uz * px - ux * pz) + nz * (ux * py - uy * px)) / squared
    return z, 1.0 - b - c, b, c
