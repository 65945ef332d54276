"""Moving least squares: quadratic patches fitted to a noisy cloud wherever a point of the
surface is requested.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from breastscan.errors import PlanningError

QUADRATIC_TERMS = 6
"""Coefficients of a quadratic height over two coordinates."""
FEWEST_POINTS = 2 * QUADRATIC_TERMS
"""Points that a patch needs so that its fit still averages noise."""
OUTLIER_SPREADS = 4.0
"""Residual, in robust standard deviations, from which a point is an outlier."""
NORMAL_SPREAD = 1.4826
"""Standard deviation over median absolute deviation of a normal distribution."""

PATCH_STEPS = 6
"""Moves of a patch towards the point that is looked for, at most."""
MOVE_TOLERANCE = 1e-6
"""Where they stop [m]."""
NEWTON_STEPS = 4
"""Steps to a line on one patch: they converge quadratically."""


@dataclass(frozen=True, kw_only=True)
class Patch:
    """The surface near a point as a quadratic height over a plane: f = c . (1, x, y, x^2, x y,
    y^2).
    """

    origin_B: Float[np.ndarray, "3"]
    """Where x, y and height are zero [m]."""
    axes: Float[np.ndarray, "3 3"]
    """Rows x, y and height direction in basis B."""
    coefficients: Float[np.ndarray, "6"]
    """c, in powers of metres."""

    def point(self, xy: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        """The surface's point over x, y in B [m]."""
        return self.origin_B + np.append(xy, self.heights(xy[None])) @ self.axes

    def tangents(self, xy: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2 3"]:
        """Derivatives of `point` with respect to x and y."""
        (x, y), (_, a, b, aa, ab, bb) = xy, self.coefficients
        slopes = np.array([a + 2 * aa * x + ab * y, b + ab * x + 2 * bb * y])
        return self.axes[:2] + slopes[:, None] * self.axes[2]

    def normal(self, xy: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        """Unit normal in B, on the side of the height axis."""
        n_B = np.cross(*self.tangents(xy))
        return n_B / np.linalg.norm(n_B)

    def heights(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Heights over x, y [m]."""
        return _terms(xy) @ self.coefficients


@dataclass(frozen=True, kw_only=True)
class MlsSurface:
    """A cloud of points with normals, read as a surface that is smooth on the scale of `radius`."""

    points_B: Float[np.ndarray, "n 3"]
    """Points in B [m]."""
    normals_B: Float[np.ndarray, "n 3"]
    """Unit normals, outwards."""
    radius: float
    """Reach of a patch [m]."""

    def __post_init__(self) -> None:
        bad = ~(np.isfinite(self.points_B).all(axis=1) & np.isfinite(self.normals_B).all(axis=1))
        if bad.any():
            raise PlanningError(
                f"{int(bad.sum())} of {len(self.points_B)} points or normals are not finite: drop "
                "them first",
                self.points_B[bad],
            )

    @cached_property
    def tree(self) -> KDTree:
        """Neighbour search over the points."""
        return KDTree(self.points_B)

    def near(self, p_B: Float[np.ndarray, "3"]) -> Float[np.ndarray, "k 3"]:
        """The points within `radius`.

        Raises:
            PlanningError: They are too few for a patch.
        """
        near_B = self.points_B[self.tree.query_ball_point(p_B, self.radius)]
        if len(near_B) < FEWEST_POINTS:
            raise PlanningError(
                f"only {len(near_B)} points within {self.radius * 1e3:.0f} mm of "
                f"{np.round(p_B * 1e3, 1)} mm in B, a patch needs {FEWEST_POINTS}: look at the "
                "hole in the cloud, keep more points, or widen the patches",
                p_B,
            )
        return near_B

    def patch(self, origin_B: Float[np.ndarray, "3"], n_B: Float[np.ndarray, "3"]) -> Patch:
        """Fit the points near `origin_B`, with heights along the unit vector `n_B`, outliers left
        out.

        Raises:
            PlanningError: Too few points are near.
        """
        near_B = self.near(origin_B)
        axes = axes_along(n_B)
        local = (near_B - origin_B) @ axes.T
        weights = (1.0 - np.sum((near_B - origin_B) ** 2, axis=1) / self.radius**2) ** 2
        coefficients = _weighted_fit(local, weights)
        residuals = np.abs(local[:, 2] - _terms(local[:, :2]) @ coefficients)
        spread = NORMAL_SPREAD * float(np.median(residuals))
        inlier = residuals <= OUTLIER_SPREADS * spread
        if not inlier.all():
            coefficients = _weighted_fit(local[inlier], weights[inlier])
        return Patch(origin_B=origin_B, axes=axes, coefficients=coefficients)

    def meet(
        self,
        seed_B: Float[np.ndarray, "3"],
        n_B: Float[np.ndarray, "3"],
        planes_B: Float[np.ndarray, "2 3"],
        offsets: Float[np.ndarray, "2"],
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """The skin's point on the line where two planes n . p = d meet, and its unit normal.

        Args:
            seed_B: A point near it [m].
            n_B: About the normal there.
            planes_B: The planes' normals n.
            offsets: Their d [m].

        Raises:
            PlanningError: The skin does not come to the line, or has a hole there.
        """
        p_B = seed_B
        for _ in range(PATCH_STEPS):
            patch = self.patch(p_B, n_B)
            xy = _on_line(patch, planes_B, offsets)
            if not np.linalg.norm(xy) < self.radius:
                raise PlanningError(
                    f"the skin near {np.round(seed_B * 1e3)} mm in B does not come to where the "
                    "path is to pass: keep the path lower than the top and inside the rim of what "
                    "was seen",
                    seed_B,
                )
            p_B, n_B = patch.point(xy), patch.normal(xy)
            if np.linalg.norm(p_B - patch.origin_B) < MOVE_TOLERANCE:
                break
        return p_B, n_B


def _on_line(patch: Patch, planes_B: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Where a patch meets the line of two planes, by Newton's method."""
    xy = np.zeros(2)
    for _ in range(NEWTON_STEPS):
        xy -= np.linalg.solve(planes_B @ patch.tangents(xy).T, planes_B @ patch.point(xy) - offsets)
    return xy


def axes_along(n_B: np.ndarray) -> np.ndarray:
    """A right-handed basis, in rows, whose third axis is `n_B`."""
    x_B = np.cross(np.eye(3)[np.argmin(np.abs(n_B))], n_B)
    x_B /= np.linalg.norm(x_B)
    return np.stack([x_B, np.cross(n_B, x_B), n_B])


def _terms(xy: np.ndarray) -> np.ndarray:
    x, y = xy.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _weighted_fit(local: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Coefficients of the quadratic nearest to the points, by the normal equations in
    coordinates of order 1.
    """
    scale = np.abs(local[:, :2]).max()
    terms = _terms(local[:, :2] / scale)
    weighted = terms * weights[:, None]
    scaled = np.linalg.lstsq(weighted.T @ terms, weighted.T @ local[:, 2], rcond=None)[0]
    return scaled / scale ** np.array([0, 1, 1, 2, 2, 2])
