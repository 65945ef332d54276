"""Which points of a cloud lie on the surface that most of them show. (Not in the paper, whose
filter goes by the distance of neighbours alone: it knows no lonely clusters, takes sparse flanks
away, and moves with the outliers that it is to find.)

Neighbours are linked that a step along the surface joins, no longer than points lie apart there;
what hangs together with hardly any others is left out. So is what hovers over more of the surface
than lies beside it.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from breastscan.cloud.filters import grid_sample
from breastscan.cloud.skin_fit import FEWEST
from breastscan.geometry import robust

CELL = 1e-3
"""Edge of the cubes of which one point each is looked at [m]: lines of a scanner are then no denser
along than across."""
AROUND = 6
"""Points that lie around one, the farthest of which tells how far apart they lie."""
NEIGHBOURS = 24
"""Points that are looked at around each."""
LINK = 2.0
"""Longest step, over how far apart points lie at either end [-]."""
SPARSE = 2.0
"""How far apart points may lie, over the usual [-]: flanks are seen by fewer than chests."""
STEEP = 0.7
"""Sine of the steepest step against the surface at either end."""
LEAST_OFF = 1.5e-3
"""Points nearer to the surface than this belong to it in any case [m]."""
NOISE = 5.0
"""Distance from the surface in standard deviations that noise hardly reaches [-]."""
LEAST_SHARE = 0.02
"""Of the points, that hang together [-]; `FEWEST` at least."""
OUTNUMBERED = 2.0
"""Points over or under one that leave it out, for each beside it."""


def on_surface(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, "n"]:
    """Points on the surface.

    Args:
        points: `FEWEST` or more, no two alike [m].
        normals: Unit vectors along or against the surface's.
    """
    thin = grid_sample(points, CELL)
    kept = _linked_and_over(points[thin], normals[thin])
    return kept[np.asarray(KDTree(points[thin]).query(points)[1])]


def _linked_and_over(p: np.ndarray, n: np.ndarray) -> np.ndarray:
    k = min(NEIGHBOURS, len(p) - 1)
    length, neighbour = (np.asarray(found)[:, 1:] for found in KDTree(p).query(p, k=k + 1))
    apart = length[:, min(AROUND, k) - 1]
    step = p[neighbour] - p[:, None]
    height = np.abs(np.einsum("nkj,nj->nk", step, n))
    of_other = np.abs(np.einsum("nkj,nkj->nk", step, n[neighbour]))
    least = max(LEAST_OFF, NOISE * robust.deviation(height[:, :AROUND].ravel()))
    allowed = np.maximum(STEEP * length, least)
    links = (height < allowed) & (of_other < allowed)
    apart = np.minimum(apart, SPARSE * np.median(apart))
    links &= length < LINK * np.minimum(apart[:, None], apart[neighbour])
    i, j = np.nonzero(links)
    graph = coo_array((np.ones(len(i)), (i, neighbour[i, j])), shape=(len(p), len(p)))
    label = connected_components(graph, directed=False)[1]
    kept = np.bincount(label)[label] >= max(FEWEST, LEAST_SHARE * len(p))
    across = np.sqrt(np.maximum(length**2 - height**2, 0.0)) < np.median(apart)
    beside, over = across & (height < least), across & (height >= least)
    return kept & (over.sum(axis=1) < OUTNUMBERED * (1 + beside.sum(axis=1)))
