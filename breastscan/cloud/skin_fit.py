"""The smooth skin that sightings of it show: least squares with robust weights and a smoothness
that is learned place by place (`cloud.smoothness`). (Not in the paper.)

A sighting is a point that may be off along a known line: along the line of sight where disparity
may be off, along the normal where nothing else is known. The radius in the point's direction is off
by the line's slope against the skin times that.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from breastscan.cloud.smoothness import Smoothness
from breastscan.errors import PerceptionError
from breastscan.geometry import banded, bicubic, robust, se3
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import REACH, Skin, direction_slopes, directions

CELLS = 40
"""Of the spline's grid along a side of the chart: 5 mm on the flank, so that a nipple of 4 mm
stands."""
ROUNDS, ROUNDS_AFTER = 5, 2
"""Fits in which slopes, weights and smoothness settle, from nothing and from a fit nearby."""
BALL = 0.06
"""Radius of the ball that a first fit begins from [m]."""
ROBUST_SCALE = 2.4
"""A residual as many standard deviations large counts half (Cauchy's weight, 95 % efficient under
normal noise)."""
FLATTEST = 0.05
"""Smallest slope of a line of sight against the skin that is told from none [-]."""
RIDGE = 1e-2
"""Precision added to every coefficient [1/m^2]: those that nothing tells of stay finite."""
NIPPLE = 1.5
"""Over how many cells a nipple's fades, a standard deviation."""
THIRD_MIDDLE = 1.5
"""Of the four coefficients of a third difference, from its first."""
SQUARES = 76
"""Of the chart along a side, in which skin is known or not: 3 mm on the flank."""
FEWEST = 100
"""Sightings that a skin can be fitted to."""
CLOUD_SIGMA = 2e-5
"""Least noise of a cloud's points [m]; how much there really is, the fit finds."""
PLAN_CELL = 5e-3
"""Side of the squares that tell where on the chest there is breast [m]."""


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """Points on the skin, each off by an unknown length along its own line."""

    points: Float[np.ndarray, "n 3"]
    """In a frame A [m]."""
    lines: Float[np.ndarray, "n 3"]
    """Unit vectors of those lines in A."""
    residual: Float[np.ndarray, "n"]
    """What was measured, less what the point makes expected, in standard deviations."""
    slope: Float[np.ndarray, "n"]
    """Change of the residual with the skin's shift along the line [1/m]."""

    @staticmethod
    def of_cloud(
        points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> "Sightings":
        """Points with independent errors along their normals, all as large as one another."""
        return Sightings(
            points=points,
            lines=normals,
            residual=np.zeros(len(points)),
            slope=np.full(len(points), 1.0 / CLOUD_SIGMA),
        )


def chart_pose(points: Float[np.ndarray, "n 3"], chest: Plane) -> Float[np.ndarray, "4 4"]:
    """Where the chart of a breast's skin stands: over the middle of what the points cover of the
    chest, its axis along the chest's normal.
    """
    axes = se3.axes_along(chest.normal)
    covered = np.unique(np.floor(points @ axes[:2].T / PLAN_CELL), axis=0)
    middle = (covered.mean(axis=0) + 0.5) * PLAN_CELL @ axes[:2]
    return se3.pose(axes.T, middle - chest.normal * chest.heights(middle[None])[0])


@dataclass(frozen=True, kw_only=True)
class SkinFit:
    """A fitted skin, and what a next fit begins from."""

    skin: Skin
    smoothness: Smoothness


def fit_skin(
    sightings: Sightings,
    X_AN: Float[np.ndarray, "4 4"],
    before: SkinFit | None = None,
    nipple: float = 0.0,
) -> SkinFit:
    """The skin in A that the sightings show, on a chart whose pose is `X_AN`.

    Args:
        sightings: At least `FEWEST`.
        X_AN: As `chart_pose` gives it.
        before: An earlier fit on the same chart, near this one: saves time.
        nipple: Least standard deviation of the coefficients' third differences on the breast's top
            [m], where the sightings are too few to teach that a nipple stands there.

    Raises:
        PerceptionError: They are too few.
    """
    require_enough(len(sightings.points))
    skin = _blank(X_AN) if before is None else before.skin
    ab = skin.chart(sightings.points)
    problem = _Problem.of(sightings, skin, ab)
    m = len(skin.radii)
    smoothness = Smoothness.unknown(m) if before is None else before.smoothness
    for _ in range(ROUNDS if before is None else ROUNDS_AFTER):
        factor, right_side = problem.equations(skin, smoothness)
        skin = replace(
            skin,
            radii=banded.solved(factor, right_side).reshape(m, m),
            covariance=banded.inverse_within_band(factor),
        )
        smoothness = smoothness.learned(skin.radii, skin.covariance, _nipple(skin, nipple))
    return SkinFit(skin=replace(skin, support=support(ab)), smoothness=smoothness)


def _nipple(skin: Skin, spread: float) -> Float[np.ndarray, "m m"]:
    """Variance of the third differences that begin at each coefficient [m^2], for a nipple where
    the skin stands highest over the chest.
    """
    m = len(skin.radii)
    side = (np.arange(m) - 1) * 2 * REACH / (m - 3) - REACH
    heights = skin.radii * np.cos(np.hypot(side[:, None], side))
    top = np.array(np.unravel_index(np.argmax(heights), heights.shape))
    from_top = np.indices(heights.shape) + THIRD_MIDDLE - top[:, None, None]
    return spread**2 * np.exp(-np.sum(from_top**2, axis=0) / (2 * NIPPLE**2))


def require_enough(points: int) -> None:
    """Refuse to fit a skin to hardly anything.

    Raises:
        PerceptionError: There are fewer than `FEWEST` points.
    """
    if points < FEWEST:
        raise PerceptionError(
            f"expected {FEWEST} points of the skin or more, got {points}: look at the disparity "
            "for missing depth",
            points,
        )


def fit_cloud(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], chest: Plane
) -> Skin:
    """The skin in A that a cloud with outward normals shows, on a chart over `chest`.

    Raises:
        PerceptionError: It has hardly any points, or one that is not finite.
    """
    bad = ~(np.isfinite(points).all(axis=1) & np.isfinite(normals).all(axis=1))
    if bad.any():
        raise PerceptionError(
            f"{int(bad.sum())} of {len(points)} points or normals are not finite: drop them first",
            points[bad],
        )
    sightings = Sightings.of_cloud(points, normals)
    return fit_skin(sightings, chart_pose(points, chest)).skin


def _blank(X_AN: Float[np.ndarray, "4 4"]) -> Skin:
    """A ball, of which nothing was seen."""
    m = CELLS + 3
    return Skin(
        X_AN=X_AN,
        radii=np.full((m, m), BALL),
        covariance=np.zeros((m * m, bicubic.bandwidth(m) + 1)),
        support=np.zeros((SQUARES, SQUARES), bool),
    )


@dataclass(frozen=True, kw_only=True)
class _Problem:
    """Sightings on a chart."""

    sightings: Sightings
    ab: Float[np.ndarray, "n 2"]
    radius: Float[np.ndarray, "n"]
    """Of the points [m]."""
    lean_terms: Float[np.ndarray, "n 3"]
    """Of the change of the radius with a shift along the line [-]: the constant, and what the
    radius' relative slopes along a and b add [rad]."""
    first: Int[np.ndarray, "n"]
    weights: Float[np.ndarray, "n 16"]
    """Of the spline's coefficients, as `bicubic.first_numbers` has them."""

    @staticmethod
    def of(sightings: Sightings, skin: Skin, ab: Float[np.ndarray, "n 2"]) -> "_Problem":
        m = len(skin.radii)
        first, weights = bicubic.first_numbers((ab + REACH) * (m - 3) / (2 * REACH), m, m)
        return _Problem(
            sightings=sightings,
            ab=ab,
            radius=np.linalg.norm(sightings.points - skin.centre, axis=1),
            lean_terms=_lean_terms(ab, se3.rotate(se3.inverse(skin.X_AN), sightings.lines)),
            first=first,
            weights=weights,
        )

    def equations(
        self, skin: Skin, smoothness: Smoothness
    ) -> tuple[Float[np.ndarray, "n band"], Float[np.ndarray, "n"]]:
        """The factorized normal equations of the next fit, and their right side."""
        m = len(skin.radii)
        r, r_a, r_b = skin.radius(self.ab)[:, :3].T
        # nothing is known of a blank skin's distance from the points
        shift = r - self.radius if skin.covariance.any() else np.zeros(len(r))
        constant, by_a, by_b = self.lean_terms.T
        lean = constant + (by_a * r_a + by_b * r_b) / r
        lean = np.copysign(np.maximum(np.abs(lean), FLATTEST), lean)
        precision, off = _weighted(self.sightings.residual, self.sightings.slope / lean, shift)
        matrix, right_side = np.zeros_like(skin.covariance), np.zeros(m * m)
        bicubic.add_normal_equations(
            self.first, self.weights, precision, self.radius + off, m, matrix, right_side
        )
        smoothness.add_to(matrix)
        matrix[:, 0] += RIDGE
        return banded.factorized(matrix), right_side


def _lean_terms(
    ab: Float[np.ndarray, "n 2"], lines_N: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """What (v . n) / (u . n) consists of at directions u, for lines v and the normals n of whatever
    radius r: n has the direction of r^2 u_a x u_b + r r_b u_a x u + r r_a u x u_b.
    """
    u = directions(ab)
    u_a, u_b = direction_slopes(ab)
    crosses = np.cross(u_a, u_b), np.cross(u, u_b), np.cross(u_a, u)
    along = np.stack([np.sum(lines_N * n, axis=1) for n in crosses], axis=1)
    return along / np.sum(u * crosses[0], axis=1, keepdims=True)


def _weighted(
    residual: Float[np.ndarray, "n"], slope: Float[np.ndarray, "n"], shift: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Precision of each radius [1/m^2], outliers counting little, and how far it is from the
    point's own [m].
    """
    left = np.abs(residual + slope * shift)
    scale = max(1.0, robust.deviation(left))
    precision = (slope / scale) ** 2 / (1.0 + (left / (ROBUST_SCALE * scale)) ** 2)
    told = np.abs(slope) > 0
    return precision, np.where(told, -residual / np.where(told, slope, 1.0), 0.0)


def support(ab: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "s s"]:
    """Squares of the chart in which skin was seen, at these places [rad], gaps of a square
    closed.
    """
    edges = np.linspace(-REACH, REACH, SQUARES + 1)
    seen = np.histogram2d(*ab.T, bins=[edges, edges])[0] > 0
    return ndimage.binary_closing(seen, np.ones((3, 3)))
