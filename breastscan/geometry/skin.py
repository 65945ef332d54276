"""The skin as one smooth surface: what every later stage asks for points, normals, curvatures and
how sure they are.

The radius is a bicubic spline over directions from the middle of the breast's foot. Directions are
charted so that distances from the axis are kept (azimuthal equidistant): the chart coordinates
(a, b) [rad] are the direction's angle from the axis times the unit vector of its azimuth. The axis
is the chest's outward normal, so that the foot lies at pi / 2.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from breastscan.geometry import bicubic, se3
from breastscan.geometry.compiled import kernel

REACH = 1.9
"""The chart ends at this angle from its axis, along either coordinate [rad]: beyond the foot, which
a sagging breast overhangs."""
CAUTION = 0.4
"""Step of a ray that seeks the skin over its height above it [-]: the skin leans by less than 66
degrees against the directions from the middle of the foot, or a ray may pass a summit."""
MIN_STEP = 2e-4
"""Smallest such step [m]."""
HIT_TOLERANCE = 1e-9
"""Height at which a ray has met the skin [m]."""
MOST_CHORDS = 20
"""Of a ray's last step, of which it takes three or four."""
NEAR_AXIS = 1e-3
"""Square of the angle from the axis below which series stand for quotients of 0 and 0."""


@dataclass(frozen=True, kw_only=True)
class Skin:
    """A smooth surface in a frame A, star-shaped about the middle of its foot."""

    X_AN: Float[np.ndarray, "4 4"]
    """Pose of the chart: origin in the middle of the foot, z along its axis."""
    radii: Float[np.ndarray, "m m"]
    """Coefficients of the radius [m], by rows of a and columns of b."""
    covariance: Float[np.ndarray, "n band"]
    """Of the coefficients, row by row, within the band that one place depends on [m^2]."""
    support: Bool[np.ndarray, "s s"]
    """Where skin was seen: the chart in squares, rows along a, columns along b."""

    def chart(self, p: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Chart coordinates of the directions in which points lie [rad]."""
        local = se3.transform(se3.inverse(self.X_AN), p)
        across = np.linalg.norm(local[..., :2], axis=-1)
        angle = np.arctan2(across, local[..., 2])
        with np.errstate(invalid="ignore", divide="ignore"):
            stretch = np.where(across > 0, angle / across, 0.0)
        return local[..., :2] * stretch[..., None]

    def radius(self, ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 6"]:
        """Radius [m], its first derivatives by a and b [m/rad], and its second: aa, ab, bb
        [m/rad^2].
        """
        return bicubic.values(self.radii, self._grid(ab)) * self._per_radian ** np.array(
            [0, 1, 1, 2, 2, 2]
        )

    def points(self, ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Points of the skin [m]."""
        return se3.transform(self.X_AN, self.radius(ab)[:, :1] * directions(ab))

    def tangents(
        self, ab: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Derivatives of `points` with respect to a and b [m/rad]."""
        r = self.radius(ab)
        u = directions(ab)
        u_a, u_b = direction_slopes(ab)
        along, across = r[:, 1:2] * u + r[:, :1] * u_a, r[:, 2:3] * u + r[:, :1] * u_b
        return se3.rotate(self.X_AN, along), se3.rotate(self.X_AN, across)

    def normals(self, ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Outward unit normals."""
        normals = np.cross(*self.tangents(ab))
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def curvatures(self, ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Principal curvatures, the larger first, positive where the skin bulges [1/m]."""
        r, u = self.radius(ab), directions(ab)
        u_a, u_b = direction_slopes(ab)
        u_aa, u_ab, u_bb = _direction_bends(ab)
        value, along = r[:, :1], r[:, 1:2]
        across = r[:, 2:3]
        p_a, p_b = along * u + value * u_a, across * u + value * u_b
        n = np.cross(p_a, p_b)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        p_aa = r[:, 3:4] * u + 2 * along * u_a + value * u_aa
        p_ab = r[:, 4:5] * u + along * u_b + across * u_a + value * u_ab
        p_bb = r[:, 5:6] * u + 2 * across * u_b + value * u_bb
        first = _symmetric(_dot(p_a, p_a), _dot(p_a, p_b), _dot(p_b, p_b))
        second = -_symmetric(_dot(p_aa, n), _dot(p_ab, n), _dot(p_bb, n))
        # of the pencil second - k first, in coordinates in which the first form is the unit
        whitening = np.linalg.inv(np.linalg.cholesky(first))
        k = np.linalg.eigvalsh(whitening @ second @ np.swapaxes(whitening, 1, 2))
        return k[:, ::-1]

    def sigma(self, ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Standard deviation of the skin along its normal [m]: of what noise in the pictures and
        the shape's own variation leave open. An error of the rig is none of it.
        """
        m = len(self.radii)
        variance = bicubic.variances(self.covariance, self._grid(ab), m, m)
        u = se3.rotate(self.X_AN, directions(ab))
        return np.sqrt(np.maximum(variance, 0.0)) * np.abs(_dot(u, self.normals(ab)))

    def known(self, ab: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Where skin was seen; elsewhere the surface is only a guess that goes on smoothly."""
        squares = len(self.support)
        cell = np.floor((ab + REACH) / (2 * REACH) * squares)
        inside = np.all((cell >= 0) & (cell < squares), axis=1)
        row, column = np.where(inside[:, None], cell, 0).astype(int).T
        return inside & self.support[row, column]

    def first_hits(
        self,
        origin: Float[np.ndarray, "3"],
        rays: Float[np.ndarray, "n 3"],
        start: Float[np.ndarray, "n"] | None = None,
    ) -> Float[np.ndarray, "n"]:
        """How far along each ray from a place outside the skin comes first [lengths of the ray],
        NaN where it misses; skin that was not seen is met as well.

        Args:
            origin: Where the rays begin [m].
            rays: Their directions.
            start: How far the skin has hardly come yet; saves time [lengths of the ray].
        """
        X_NA = se3.inverse(self.X_AN)
        result = np.empty(len(rays))
        _first_hits(
            self.radii,
            self._per_radian,
            float(self.radii.max()),
            se3.transform(X_NA, origin),
            se3.rotate(X_NA, rays),
            np.zeros(len(rays)) if start is None else start,
            result,
        )
        return result

    def seen_from(self, X_BA: Float[np.ndarray, "4 4"]) -> "Skin":
        """This skin of frame A, in frame B."""
        return replace(self, X_AN=X_BA @ self.X_AN)

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the foot, from which directions are told [m]."""
        return self.X_AN[:3, 3]

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Unit vector of the chart's axis, outwards."""
        return self.X_AN[:3, 2]

    @cached_property
    def _per_radian(self) -> float:
        """Cells of the spline's grid along an angle [1/rad]."""
        return (len(self.radii) - 3) / (2 * REACH)

    def _grid(self, ab: np.ndarray) -> np.ndarray:
        return (ab + REACH) * self._per_radian


def directions(ab: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors in the chart's own frame."""
    s, c, _, _ = _sines(ab)
    return np.column_stack([ab * s[:, None], c])


def direction_slopes(
    ab: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Derivatives of `directions` by a and by b."""
    s, _, s1, _ = _sines(ab)
    a, b = ab.T
    mixed = 2 * a * b * s1
    return (
        np.stack([s + 2 * a * a * s1, mixed, -a * s], axis=1),
        np.stack([mixed, s + 2 * b * b * s1, -b * s], axis=1),
    )


def _direction_bends(ab: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives of `directions`: by a twice, mixed, by b twice."""
    s, _, s1, s2 = _sines(ab)
    a, b = ab.T
    a_by_b = 2 * b * s1 + 4 * a * a * b * s2
    b_by_a = 2 * a * s1 + 4 * a * b * b * s2
    return (
        np.stack([6 * a * s1 + 4 * a**3 * s2, a_by_b, -s - 2 * a * a * s1], axis=1),
        np.stack([a_by_b, b_by_a, -2 * a * b * s1], axis=1),
        np.stack([b_by_a, 6 * b * s1 + 4 * b**3 * s2, -s - 2 * b * b * s1], axis=1),
    )


def _sines(ab: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """With q the square of the angle t from the axis: sin(t) / t, cos(t), and the first and second
    derivatives of sin(t) / t by q.
    """
    q = np.sum(ab**2, axis=1)
    t = np.sqrt(q)
    s, c = np.sinc(t / np.pi), np.cos(t)
    small = q < NEAR_AXIS
    over = np.where(small, 1.0, q)
    s1 = np.where(small, -1 / 6 + q / 60 - q * q / 1680, (c - s) / (2 * over))
    s2 = np.where(small, 1 / 60 - q / 840 + q * q / 30240, -(s / 2 + 3 * s1) / (2 * over))
    return s, c, s1, s2


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=1)


def _symmetric(aa: np.ndarray, ab: np.ndarray, bb: np.ndarray) -> np.ndarray:
    return np.stack([np.stack([aa, ab], axis=1), np.stack([ab, bb], axis=1)], axis=1)


@kernel
def _height(radii, per_radian, x, y, z):
    """Distance of a point of the chart's frame from the origin, less the skin's in its direction
    [m].
    """
    across = np.sqrt(x * x + y * y)
    angle = np.arctan2(across, z)
    stretch = angle / across if across > 0.0 else 0.0
    a = (min(max(x * stretch, -REACH), REACH) + REACH) * per_radian
    b = (min(max(y * stretch, -REACH), REACH) + REACH) * per_radian
    return np.sqrt(across * across + z * z) - bicubic.value(radii, a, b)


@kernel
def _height_along(radii, per_radian, origin, ray, s):
    """`_height` of the point at `s` along a ray."""
    return _height(
        radii,
        per_radian,
        origin[0] + s * ray[0],
        origin[1] + s * ray[1],
        origin[2] + s * ray[2],
    )


@kernel
def _between(radii, per_radian, origin, ray, above, height_above, below, height_below):
    """Where between a place above the skin and one below it a ray meets the skin: false position,
    the end that stays counting half (the Illinois rule).
    """
    stayed = 0
    s = below
    for _ in range(MOST_CHORDS):
        s = above + (below - above) * height_above / (height_above - height_below)
        height = _height_along(radii, per_radian, origin, ray, s)
        if abs(height) < HIT_TOLERANCE:
            break
        if height < 0.0:
            below = s
            height_below = height
            if stayed == 1:
                height_above *= 0.5
            stayed = 1
        else:
            above = s
            height_above = height
            if stayed == -1:
                height_below *= 0.5
            stayed = -1
    return s


@kernel
def _march(radii, per_radian, farthest, origin, ray, first, last):
    """How far along a ray the skin comes first, from `first` to `last` [m]; NaN if it does not.

    Steps are a share of the height over the skin.
    """
    before = first
    height_before = _height_along(radii, per_radian, origin, ray, before)
    while before < last and origin[2] + before * ray[2] >= -0.5 * farthest:
        s = before + max(CAUTION * height_before, MIN_STEP)
        height = _height_along(radii, per_radian, origin, ray, s)
        if height < 0.0:
            return _between(radii, per_radian, origin, ray, before, height_before, s, height)
        before = s
        height_before = height
    return np.nan


@kernel
def _first_hits(radii, per_radian, farthest, origin, rays, start, result):
    """March each ray from where its start is told, and from the ball that holds the skin if that
    lies below the skin.
    """
    ray = np.empty(3)
    for n in range(rays.shape[0]):
        length = np.sqrt(rays[n, 0] ** 2 + rays[n, 1] ** 2 + rays[n, 2] ** 2)
        ray[:] = rays[n] / length
        middle = -(origin[0] * ray[0] + origin[1] * ray[1] + origin[2] * ray[2])
        squared = origin[0] ** 2 + origin[1] ** 2 + origin[2] ** 2
        half = farthest * farthest - squared + middle * middle
        result[n] = np.nan
        if half <= 0.0:
            continue
        half = np.sqrt(half)
        first = max(middle - half, start[n] * length)
        if _height_along(radii, per_radian, origin, ray, first) < 0.0:
            first = middle - half
        result[n] = _march(radii, per_radian, farthest, origin, ray, first, middle + half) / length
