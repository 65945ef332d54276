"""Normals of a cloud's surface that all point to one side of it: those of the file where they are
of use, else estimated.

From each point its sign goes on to its neighbours along the minimum spanning tree over the angles
between them [Hoppe, Sec. 3.3].
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from breastscan.cloud.filters import grid_sample
from breastscan.cloud.normals import estimate_normals
from breastscan.cloud.on_surface import CELL

SOURCE = 2e-3
"""Edge of the cubes of which one point each tells normals [m]."""
AROUND = 40
"""Points that one is estimated from, within some 8 mm: so many that ten which hover over the skin
do not turn it."""
NEIGHBOURS = 8
"""That a sign goes on to."""
LEAST_ANGLE = 1e-6
"""Added to one less the cosine of the angle between normals: 0 would be no edge of a graph."""
ALONG = np.cos(np.radians(40.0))
"""Cosine of the angle from the surface's own normal up to which a file's is taken [-]: some are of
few neighbours, or of the faces of a coarse mesh."""
USEFUL = 0.7
"""Share of a file's normals that must be that near for them to be taken at all [-]."""
SIGNED = 0.95
"""Share of them that must point to the same side for that to be outwards [-]."""


@dataclass(frozen=True, kw_only=True)
class Oriented:
    """Unit normals that point to one side."""

    normals: Float[np.ndarray, "n 3"]
    is_told: bool
    """Whether the file tells which side that is; else it is the one to which the cloud bulges."""
    estimated: int = 0
    """Of how many points the file's normals are not taken."""

    @property
    def turned(self) -> "Oriented":
        """To the other side."""
        return replace(self, normals=-self.normals)


def along_surface(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals to either side of `FEWEST` points or more [m]."""
    thin = points[grid_sample(points, SOURCE)]
    return estimate_normals(thin, at=points, k=min(AROUND, len(thin)))


def oriented(
    points: Float[np.ndarray, "n 3"],
    surface: Float[np.ndarray, "n 3"],
    given: Float[np.ndarray, "n 3"] | None,
) -> Oriented:
    """The normals of a surface, as its points [m] and the file tell it.

    Args:
        points: On the surface, in any frame A.
        surface: As `along_surface` gives them.
        given: What the file holds, of any length, or NaN; None where it holds none.
    """
    own, piece = _of_one_sign(points, surface)
    if given is None:
        return Oriented(normals=_bulging(points, own, piece), is_told=False, estimated=len(points))
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = given / np.linalg.norm(given, axis=1, keepdims=True)
    cosine = np.nan_to_num(np.sum(unit * own, axis=1))
    useful = np.abs(cosine) > ALONG
    votes = np.bincount(piece, weights=np.where(useful, np.sign(cosine), 0.0))
    own = own * np.where(votes[piece] < 0, -1.0, 1.0)[:, None]
    cosine = cosine * np.where(votes[piece] < 0, -1.0, 1.0)
    is_told = bool(np.mean(cosine[useful] > 0) > SIGNED) if useful.any() else False
    if np.mean(useful) < USEFUL or not is_told:
        return Oriented(normals=_bulging(points, own, piece), is_told=False, estimated=len(points))
    taken = useful & (cosine > 0)
    return Oriented(
        normals=np.where(taken[:, None], unit, own), is_told=True, estimated=int(np.sum(~taken))
    )


def bulge(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> float:
    """How far the surface bulges to the side of its normals [m]: what a body has outwards."""
    return float(np.mean(np.sum((points - points.mean(axis=0)) * normals, axis=1)))


def _of_one_sign(
    points: Float[np.ndarray, "n 3"], surface: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """The normals with the same sign all over each connected piece, and each point's piece."""
    thin = grid_sample(points, CELL)
    p, n = points[thin], surface[thin]
    k = min(NEIGHBOURS, len(p) - 1)
    neighbour = np.asarray(KDTree(p).query(p, k=k + 1)[1])[:, 1:]
    i, j = np.repeat(np.arange(len(p)), k), neighbour.ravel()
    angle = 1.0 + LEAST_ANGLE - np.abs(np.sum(n[i] * n[j], axis=1))
    # either end may be the other's neighbour; an edge told twice would count double
    low, high = np.minimum(i, j), np.maximum(i, j)
    _, once = np.unique(low * len(p) + high, return_index=True)
    graph = coo_array((angle[once], (low[once], high[once])), shape=(len(p), len(p)))
    tree = minimum_spanning_tree(graph.tocsr())
    piece = connected_components(tree, directed=False)[1]
    sign = np.ones(len(p))
    for root in np.unique(piece, return_index=True)[1]:
        order, before = breadth_first_order(tree, root, directed=False)
        same = np.sign(np.sum(n[order[1:]] * n[before[order[1:]]], axis=1)).tolist()
        for point, s in zip(order[1:].tolist(), same, strict=True):
            sign[point] = s * sign[before[point]]
    nearest = KDTree(p).query(points)[1]
    near = (sign[:, None] * n)[nearest]
    return surface * np.where(np.sum(surface * near, axis=1) < 0, -1.0, 1.0)[:, None], piece[
        nearest
    ]


def _bulging(points: np.ndarray, normals: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """The normals of the largest piece to the side to which it bulges, of others to the same."""
    largest = piece == np.argmax(np.bincount(piece))
    side = 1.0 if bulge(points[largest], normals[largest]) > 0 else -1.0
    axis = side * normals[largest].mean(axis=0)
    along = np.bincount(piece, weights=normals @ axis)
    return normals * np.where(along[piece] < 0, -1.0, 1.0)[:, None]
