"""Simple hulls around what may collide, and how far apart two of them are.

The signed distance of a point to a sphere, capsule, cylinder or box has a closed form, and along a
straight segment it is a convex function, overlaps included. Of two hulls the nearest points lie on
an edge of one of them: a capsule is one segment with a radius, a box its twelve edges, a cylinder
as many lines along its side. So the gap is the minimum over some segments, each by a golden-section
search. Nothing is assumed of how deep hulls lie in each other, where `mj_geomDistance` (MuJoCo
4.0.0) errs.
"""

import math
from dataclasses import dataclass
from itertools import product
from typing import Literal, no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int

from breastscan.errors import ConfigError

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}
"""How many lengths tell the size of each kind of hull."""
KINDS = tuple(SIZES)
"""The kinds; a kernel knows them by their place in it."""
SPHERE, CAPSULE, CYLINDER, BOX = range(4)
NOT_RIGID = 1e-6
"""Maximum by which a pose's rotation may miss one, entry by entry: rounded files."""
SIDE_LINES = 32
"""Lines along a cylinder's side: of a cylinder of 41 mm in radius they miss .2 mm at most."""
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
SEARCH_STEPS = 24
"""Of a golden-section search: 10 um of a metre are left, on a flat minimum."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A simple hull that the arm must keep clear of, or that it carries."""

    name: str
    kind: Literal["sphere", "capsule", "cylinder", "box"]
    size: tuple[float, ...]
    """Of a sphere its radius, of capsule and cylinder radius and half length along z, of a box its
    half lengths [m]."""
    X: Float[np.ndarray, "4 4"]
    """Where it lies: in F if the arm carries it, else in B [m]."""

    def __post_init__(self) -> None:
        numbers = SIZES[self.kind]
        if len(self.size) != numbers or not all(length > 0 for length in self.size):
            why = f"the size of {self.name}, a {self.kind}, must be {numbers} positive lengths"
            raise ConfigError(f"{why} [m], got {self.size}", self.size)
        require_rigid(self.X, f"the pose of {self.name}")

    @property
    def radius(self) -> float:
        """Radius of the ball around its centre that encloses it [m]."""
        if self.kind == "capsule":
            return sum(self.size)
        return float(np.linalg.norm(self.size))


def require_rigid(X: np.ndarray, what: str) -> None:
    """Refuse a matrix that is no pose.

    Raises:
        ConfigError: It is not.
    """
    R = X[:3, :3]
    rigid = np.abs(R @ R.T - np.eye(3)).max() < NOT_RIGID and np.linalg.det(R) > 0
    if not (rigid and np.array_equal(X[3], [0.0, 0.0, 0.0, 1.0])):
        raise ConfigError(f"{what} is not a rigid pose: {X.tolist()}", X)


@dataclass(frozen=True, kw_only=True)
class HullTable:
    """Hulls as the kernels take them."""

    kinds: Int[np.ndarray, "h"]
    """Places in `KINDS`."""
    sizes: Float[np.ndarray, "h 3"]
    """Their lengths, then zeros [m]."""
    balls: Float[np.ndarray, "h"]
    """Radii of the balls around their centres that enclose them [m]."""
    edges: Float[np.ndarray, "e 2 3"]
    """Segments of all hulls, each in its hull's own frame [m]."""
    firsts: Int[np.ndarray, "h+1"]
    """Where in `edges` each hull's begin, and where the last one's end."""
    radii: Float[np.ndarray, "h"]
    """Radius around a hull's segments [m]: 0 where they are edges."""

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """All of it, in this order."""
        return self.kinds, self.sizes, self.balls, self.edges, self.firsts, self.radii

    @staticmethod
    def of(shapes: list[Shape]) -> "HullTable":
        """The table of some hulls, whichever frames they are placed in."""
        edges = [_edges(shape) for shape in shapes]
        counts = [len(found) for found in edges]
        sizes = np.zeros((len(shapes), 3))
        for row, shape in zip(sizes, shapes, strict=True):
            row[: len(shape.size)] = shape.size
        round_ones = [shape.kind in ("sphere", "capsule") for shape in shapes]
        return HullTable(
            kinds=np.array([KINDS.index(shape.kind) for shape in shapes], dtype=int),
            sizes=sizes,
            balls=np.array([shape.radius for shape in shapes]),
            edges=np.concatenate([np.zeros((0, 2, 3)), *edges]),
            firsts=np.append(0, np.cumsum(counts)).astype(int),
            radii=np.where(round_ones, sizes[:, 0], 0.0),
        )


def _edges(shape: Shape) -> Float[np.ndarray, "k 2 3"]:
    """Segments of a hull, among which the nearest to another hull's surface is."""
    if shape.kind == "box":
        corners = np.array(list(product((-1.0, 1.0), repeat=3)))
        pairs = [
            (corners[i], corners[j])
            for i, j in product(range(8), repeat=2)
            if i < j and np.abs(corners[i] - corners[j]).sum() == 2.0
        ]
        return np.array(pairs) * shape.size
    axis = np.zeros((2, 3))
    if shape.kind != "sphere":
        axis[:, 2] = (-shape.size[1], shape.size[1])
    if shape.kind != "cylinder":
        return axis[None]
    angle = 2.0 * np.pi * np.arange(SIDE_LINES) / SIDE_LINES
    around = shape.size[0] * np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDE_LINES)], axis=1)
    return axis[None] + around[:, None]


# Below, `no_type_check` keeps the tests' run-time type checker from wrapping what numba compiles.


@numba.njit(cache=True)
@no_type_check
def signed_distance(kind, size, x, y, z):
    """Signed distance of a point in a hull's own frame to it [m].

    Args:
        kind: Place of the hull's kind in `KINDS`.
        size: Its lengths [m].
        x: Coordinate of the point [m].
        y: Coordinate of the point [m].
        z: Coordinate of the point, along the axis [m].
    """
    if kind == BOX:
        a = abs(x) - size[0]
        b = abs(y) - size[1]
        c = abs(z) - size[2]
    elif kind == CYLINDER:
        a = math.sqrt(x * x + y * y) - size[0]
        b = abs(z) - size[1]
        c = a
    elif kind == CAPSULE:
        beyond = max(abs(z) - size[1], 0.0)
        return math.sqrt(x * x + y * y + beyond * beyond) - size[0]
    else:
        return math.sqrt(x * x + y * y + z * z) - size[0]
    inside = min(max(a, b, c), 0.0)
    a = max(a, 0.0)
    b = max(b, 0.0)
    c = max(c, 0.0) if kind == BOX else 0.0
    return math.sqrt(a * a + b * b + c * c) + inside


@numba.njit(cache=True)
@no_type_check
def placed_distance(kind, size, X, x, y, z):
    """Signed distance of a point (x, y, z) to a hull at the pose `X` in the same frame [m]."""
    x = x - X[0, 3]
    y = y - X[1, 3]
    z = z - X[2, 3]
    return signed_distance(
        kind,
        size,
        X[0, 0] * x + X[1, 0] * y + X[2, 0] * z,
        X[0, 1] * x + X[1, 1] * y + X[2, 1] * z,
        X[0, 2] * x + X[1, 2] * y + X[2, 2] * z,
    )


@numba.njit(cache=True)
@no_type_check
def _along(kind, size, a, d, t):
    """Signed distance of the point `a + t d` of a segment [m]."""
    return signed_distance(kind, size, a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2])


@numba.njit(cache=True)
@no_type_check
def _segment_distance(kind, size, a, d, nearest):
    """The smaller of `nearest` and the signed distance of the segment from `a` along `d` [m]."""
    f0 = _along(kind, size, a, d, 0.0)
    f1 = _along(kind, size, a, d, 1.0)
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    best = min(nearest, f0, f1)
    if (f0 + f1 - length) / 2.0 >= best:  # a distance changes by no more than one moves
        return best
    low, high = 0.0, 1.0
    t1, t2 = 1.0 - GOLDEN, GOLDEN
    g1, g2 = _along(kind, size, a, d, t1), _along(kind, size, a, d, t2)
    for _ in range(SEARCH_STEPS):
        if g1 < g2:
            high, t2 = t2, t1
            g2 = g1
            t1 = high - GOLDEN * (high - low)
            g1 = _along(kind, size, a, d, t1)
        else:
            low, t1 = t1, t2
            g1 = g2
            t2 = low + GOLDEN * (high - low)
            g2 = _along(kind, size, a, d, t2)
    return min(best, g1, g2)


@numba.njit(cache=True)
@no_type_check
def _edges_distance(edges, radius, X_A, kind, size, X_B, nearest):
    """The smaller of `nearest` and the gap between one hull's segments and another hull [m]."""
    a = np.empty(3)
    d = np.empty(3)
    R = np.empty((3, 3))
    p = np.empty(3)
    for i in range(3):
        p[i] = 0.0
        for k in range(3):
            p[i] += X_B[k, i] * (X_A[k, 3] - X_B[k, 3])
        for j in range(3):
            R[i, j] = 0.0
            for k in range(3):
                R[i, j] += X_B[k, i] * X_A[k, j]
    for e in range(len(edges)):
        for i in range(3):
            a[i] = p[i]
            d[i] = 0.0
            for j in range(3):
                a[i] += R[i, j] * edges[e, 0, j]
                d[i] += R[i, j] * (edges[e, 1, j] - edges[e, 0, j])
        nearest = _segment_distance(kind, size, a, d, nearest + radius) - radius
    return nearest


@numba.njit(cache=True)
@no_type_check
def hull_distance(table, i, X_i, j, X_j, nearest):
    """The smaller of `nearest` and the signed gap between two hulls at their poses [m].

    Args:
        table: `HullTable.arrays`.
        i: Row of the one.
        X_i: Its pose.
        j: Row of the other.
        X_j: Its pose.
        nearest: Gap beyond which nothing is of interest [m].
    """
    kinds, sizes, balls, edges, firsts, radii = table
    # from the one's hull to the other's centre, less a ball around the other, and the reverse
    far = placed_distance(kinds[j], sizes[j], X_j, X_i[0, 3], X_i[1, 3], X_i[2, 3]) - balls[i]
    near = placed_distance(kinds[i], sizes[i], X_i, X_j[0, 3], X_j[1, 3], X_j[2, 3]) - balls[j]
    if max(far, near) >= nearest:
        return nearest
    if radii[j] == 0.0 or radii[i] > 0.0:
        nearest = _edges_distance(
            edges[firsts[i] : firsts[i + 1]], radii[i], X_i, kinds[j], sizes[j], X_j, nearest
        )
    if radii[i] == 0.0:
        nearest = _edges_distance(
            edges[firsts[j] : firsts[j + 1]], radii[j], X_j, kinds[i], sizes[i], X_i, nearest
        )
    return nearest
