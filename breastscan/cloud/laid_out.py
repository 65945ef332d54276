"""A cloud in no order, laid out by rows and columns as a camera far above it would see it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, KDTree

from breastscan.geometry import se3

PIXEL = 1e-3
"""Side of a pixel on what is seen [m]."""
MARGIN_PX = 4
"""Pixels around that see nothing."""
STAND_OFF = 3.0
"""Distance from which the middle is seen [m]: farther than anything within an arm's reach."""
COVERED = 0.015
"""A point so far under another of its square hides behind it [m]."""
BRIDGED = 6.0
"""Gaps between points that are closed, over the usual distance of neighbours [-]."""
LEAST_BRIDGED = 3e-3
"""Gaps that are closed in any case [m]."""


@dataclass(frozen=True, kw_only=True)
class LaidOut:
    """A cloud of frame A as the camera C sees it, all lines of sight along C's z."""

    points: Float[np.ndarray, "h w 3"]
    """What each pixel sees, in C [m], NaN where nothing is."""
    X_AC: Float[np.ndarray, "4 4"]
    corner: Float[np.ndarray, "2"]
    """x and y of the first pixel, in C [m]."""

    @staticmethod
    def along(axis: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]) -> "LaidOut":
        """Points in A [m] seen against an outward unit vector: enough to triangulate."""
        R_AC = (np.diag([1.0, -1.0, -1.0]) @ se3.axes_along(axis)).T
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        X_AC = se3.pose(R_AC, middle + STAND_OFF * axis)
        p_C = _uppermost(se3.transform(se3.inverse(X_AC), points))
        corner = p_C[:, :2].min(axis=0) - MARGIN_PX * PIXEL
        columns, rows = np.ceil((np.ptp(p_C[:, :2], axis=0)) / PIXEL).astype(int) + 2 * MARGIN_PX
        x = corner[0] + PIXEL * np.arange(columns)
        y = corner[1] + PIXEL * np.arange(rows)
        xy = np.stack(np.meshgrid(x, y), axis=-1)
        seen = np.dstack([xy, _depth(p_C, xy)])
        seen[np.isnan(seen[..., 2])] = np.nan
        return LaidOut(points=seen, X_AC=X_AC, corner=corner)

    def inside(
        self, mask: Bool[np.ndarray, "h w"], points: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, "n"]:
        """Which points of A lie before or behind what a mask covers."""
        p_C = se3.transform(se3.inverse(self.X_AC), points)
        column, row = np.rint((p_C[:, :2] - self.corner) / PIXEL).astype(int).T
        h, w = mask.shape
        known = (row >= 0) & (row < h) & (column >= 0) & (column < w)
        return known & mask[np.where(known, row, 0), np.where(known, column, 0)]


def _uppermost(p_C: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """The nearest point of each pixel, without those that others nearby hide."""
    order = np.argsort(p_C[:, 2], kind="stable")
    kept = p_C[order[np.unique(_squares(p_C[order], PIXEL), return_index=True)[1]]]
    squares = _squares(kept, 2 * _spacing(kept))
    nearest = np.full(squares.max() + 1, np.inf)
    np.minimum.at(nearest, squares, kept[:, 2])
    return kept[kept[:, 2] < nearest[squares] + COVERED]


def _squares(p_C: Float[np.ndarray, "n 3"], side: float) -> Int[np.ndarray, "n"]:
    """Number of the square across the line of sight that each point lies in."""
    cells = np.floor(p_C[:, :2] / side).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)


def _spacing(p_C: Float[np.ndarray, "n 3"]) -> float:
    """Usual distance of neighbours across the line of sight [m], a pixel at least."""
    xy = p_C[:, :2]
    return max(PIXEL, float(np.median(KDTree(xy).query(xy, k=2)[0][:, 1])))


def _depth(
    p_C: Float[np.ndarray, "n 3"], xy: Float[np.ndarray, "h w 2"]
) -> Float[np.ndarray, "h w"]:
    """Depth between the points, NaN in gaps wider than those that are closed."""
    triangles = Delaunay(p_C[:, :2])
    corners = p_C[triangles.simplices][..., :2]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    gap = longest > max(LEAST_BRIDGED, BRIDGED * _spacing(p_C))
    depth = LinearNDInterpolator(triangles, p_C[:, 2])(xy)
    triangle = triangles.find_simplex(xy)
    return np.where((triangle < 0) | gap[triangle], np.nan, depth)
