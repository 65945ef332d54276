"""Cubic NURBS curves through given points, open or closed [Zhang, Eqs. 16-22].

The paper solves the control vertices of an open curve with given end tangents and closes the path
by letting its ends meet. A closed curve here comes from the cyclic system instead, so that tangent
and curvature match at the seam as well. SciPy's B-splines do the basis functions (Eq. 17) and the
evaluation (Eq. 18), on homogeneous control vertices.
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

from breastscan.errors import PlanningError
from breastscan.geometry.nurbs_system import (
    DEGREE,
    check_points,
    checked_parameters,
    checked_weights,
    chord_parameters,
    homogeneous_spline,
    interpolate_closed,
    interpolate_open,
)

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Quadrature of arc length on a knot span, nodes in [-1, 1]."""
SUBDIVISIONS = 4
"""Pieces of a knot span for the same quadrature: the speed along a span is not a polynomial."""
LENGTH_ERROR = 1e-10
"""Of the whole, by which a piece's length and its halves' may differ; else it is halved."""
ROUNDING = 1e-14
"""Of coordinates, which sums of their differences may differ by."""
CORNER_STEPS = 32
"""Pieces of a knot span in which the slowest place, dC/du at its least, is looked for."""
CORNER_WIDTH = 1 / 8
"""Of a span, within which the curve turns at most where that is called a corner."""
STILL = 1e-150
"""Length of dC/du that stands for none, so that what is divided by it stays finite."""
HALVINGS = 50
"""Of the distance to a corner: then rounding is reached."""


@dataclass(frozen=True, kw_only=True)
class Nurbs:
    """A cubic curve C(u), u in [0, 1], in any number of dimensions."""

    spline: BSpline
    """Homogeneous curve (w x, w) over u in [0, 1], periodic where the curve is closed."""
    closed: bool
    """Whether u = 1 is u = 0 again."""

    @staticmethod
    def interpolate(
        points: Float[np.ndarray, "n d"],
        closed: bool = True,
        weights: Float[np.ndarray, "w"] | None = None,
        parameters: Float[np.ndarray, "m"] | None = None,
    ) -> "Nurbs":
        """The curve through `points`, with knots at cumulative chord length.

        Args:
            points: Points in order; a closed curve returns to the first by itself, so it must not
                be repeated.
            closed: A closed curve (C2 everywhere); else an open one with the tangents at its ends
                that the parabola through the three outermost points has.
            weights: Weight of the control vertex next to each point, all positive: greater pulls
                the curve closer to its polygon there; None for 1.
            parameters: Where the curve passes the points, rising from 0, and below 1 for a closed
                curve and to 1 for an open one; None for cumulative chord length. For quantities
                that go with another curve's points.

        Raises:
            PlanningError: Fewer than 4 points, equal neighbours, numbers that are not finite or not
                positive weights.
        """
        check_points(points)
        given = chord_parameters(points, closed) if parameters is None else parameters
        u = checked_parameters(given, len(points), closed)
        solve = interpolate_closed if closed else interpolate_open
        return Nurbs(spline=solve(points, u, checked_weights(weights, len(points))), closed=closed)

    def evaluate(
        self, u: Float[np.ndarray, "*n"] | float, derivative: int = 0
    ) -> Float[np.ndarray, "*n d"]:
        """The curve or one of its derivatives with respect to u.

        Args:
            u: Parameters in [0, 1].
            derivative: Order, 0 for the curve itself.

        Raises:
            PlanningError: A parameter outside [0, 1].
        """
        if not self.is_rational:
            return self._plain_spline(self._inside(u), nu=derivative)
        return self.derivatives(u, derivative)[derivative]

    def derivatives(
        self, u: Float[np.ndarray, "*n"] | float, order: int
    ) -> Float[np.ndarray, "k *n d"]:
        """The curve and its derivatives up to `order`, at once: a rational curve's build on each
        other.

        Raises:
            PlanningError: A parameter outside [0, 1].
        """
        u = self._inside(u)
        if not self.is_rational:
            return np.stack([self._plain_spline(u, nu=k) for k in range(order + 1)])
        homogeneous = [self.spline(u, nu=k) for k in range(order + 1)]
        w = [h[..., -1:] for h in homogeneous]
        C = np.stack([h[..., :-1] for h in homogeneous])
        for k in range(order + 1):  # Leibniz' rule on the k-th derivative of w C
            for i in range(1, k + 1):
                C[k] -= comb(k, i) * w[i] * C[k - i]
            C[k] /= w[0]
        return C

    @staticmethod
    def _inside(u: np.ndarray | float) -> np.ndarray:
        u = np.asarray(u, float)
        if u.size and not (u.min() >= 0.0 and u.max() <= 1.0):
            raise PlanningError(
                "curve parameters must lie in [0, 1]: divide lengths by the curve's length", u
            )
        return u

    @property
    def is_rational(self) -> bool:
        """Whether the control vertices' weights differ."""
        return bool(np.ptp(self.weights) > 0.0)

    @property
    def weights(self) -> Float[np.ndarray, "c"]:
        """Weights of the control vertices (a closed curve's first three stand at the end again)."""
        return self.spline.c[:, -1]

    @property
    def control_points(self) -> Float[np.ndarray, "c d"]:
        """Control vertices d_i (a closed curve's first three stand at the end again)."""
        return self.spline.c[:, :-1] / self.weights[:, None]

    @property
    def breaks(self) -> Float[np.ndarray, "k"]:
        """Distinct knots in [0, 1]."""
        knots = self.spline.t[DEGREE:-DEGREE]
        return knots[np.append(True, np.diff(knots) > 0.0)]

    @cached_property
    def polynomials(self) -> Float[np.ndarray, "spans 4 h"]:
        """Homogeneous power-basis coefficients of each span between `breaks`, highest power
        first.
        """
        starts = self.breaks[:-1]
        return np.stack(
            [self.spline(starts, nu=k) / factorial(k) for k in range(DEGREE, -1, -1)], axis=1
        )

    @cached_property
    def _plain_spline(self) -> BSpline:
        return BSpline(
            self.spline.t, self.control_points, DEGREE, extrapolate=self.spline.extrapolate
        )

    def curvature(self, u: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Curvature at parameters u [1/m]."""
        _, first, second = self.derivatives(u, 2)
        speed_squared = np.sum(first**2, axis=-1)
        across = second - first * (np.sum(first * second, axis=-1) / speed_squared)[..., None]
        return np.linalg.norm(across, axis=-1) / speed_squared

    @cached_property
    def corners(self) -> Float[np.ndarray, "k"]:
        """Parameters of the places where C' all but vanishes, and ever closer to them: there the
        curve turns within little of u and less of its length.
        """
        steps = np.linspace(0.0, 1.0, CORNER_STEPS, endpoint=False)
        u = np.append((self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * steps).ravel(), 1.0)
        span = np.repeat(np.diff(self.breaks), CORNER_STEPS)
        rise, width = self._turning(u)
        near = np.minimum(width[:-1], width[1:]) < 2.0 * CORNER_WIDTH * span
        lowest = near & (rise[:-1] <= 0.0) & (rise[1:] >= 0.0)
        low, high = u[:-1][lowest], u[1:][lowest]
        for _ in range(HALVINGS if low.size else 0):
            middle = (low + high) / 2.0
            falls = self._turning(middle)[0] < 0.0
            low, high = np.where(falls, middle, low), np.where(falls, high, middle)
        at = np.concatenate([[0.0, 1.0], high])
        span = np.concatenate([span[[0, -1]], span[lowest]])
        width = self._turning(at)[1]
        sharp = width < CORNER_WIDTH * span
        away = span[sharp, None] * np.append(0.5 ** np.arange(1.0, HALVINGS), 0.0)
        away[4.0 * away < width[sharp, None]] = 0.0
        at = at[sharp, None]
        return np.unique(np.clip([at - away, at + away], 0.0, 1.0))

    def _turning(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """C'.C'', and over how much of u the curve turns, |C'| / |C''|."""
        _, first, second = self.derivatives(u, 2)
        change = np.maximum(np.linalg.norm(second, axis=-1), STILL)
        return np.sum(first * second, axis=-1), np.linalg.norm(first, axis=-1) / change

    @cached_property
    def _length_table(self) -> tuple[np.ndarray, np.ndarray]:
        """Parameters from 0 to 1 and the arc length up to each."""
        steps = np.linspace(0.0, 1.0, SUBDIVISIONS, endpoint=False)
        u = np.append((self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * steps).ravel(), 1.0)
        if self.corners.size:
            u = np.union1d(u, self.corners)
        lengths = self._piece_lengths(u)
        rounding = ROUNDING * np.abs(self.control_points).max()
        for _ in range(HALVINGS):
            middle = (u[:-1] + u[1:]) / 2.0
            halves = self._piece_lengths(np.sort(np.append(u, middle))).reshape(-1, 2).sum(axis=1)
            wrong = np.abs(halves - lengths) > LENGTH_ERROR * lengths.sum() + rounding
            if not wrong.any():
                break
            u = np.sort(np.append(u, middle[wrong]))
            lengths = self._piece_lengths(u)
        return u, np.append(0.0, np.cumsum(lengths))

    def _piece_lengths(self, u: np.ndarray) -> np.ndarray:
        """Arc length from each parameter to the next [m]."""
        half = np.diff(u) / 2.0
        nodes = u[:-1, None] + half[:, None] * (1.0 + GAUSS_NODES)
        speed = np.linalg.norm(self.evaluate(np.minimum(nodes, 1.0), 1), axis=-1)
        return half * (speed @ GAUSS_WEIGHTS)

    @property
    def smooth_pieces(self) -> Float[np.ndarray, "k"]:
        """Parameters from 0 to 1, close to each other where C' changes much within little of u."""
        return self._length_table[0]

    @property
    def length(self) -> float:
        """Arc length of the whole curve [m]."""
        return float(self._length_table[1][-1])

    def arc_length(self, u: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Arc length from the start to each parameter [m]."""
        table_u, table_s = self._length_table
        span = np.clip(np.searchsorted(table_u, u, side="right") - 1, 0, len(table_u) - 2)
        half = (u - table_u[span]) / 2.0
        nodes = table_u[span, None] + half[:, None] * (1.0 + GAUSS_NODES)
        speed = np.linalg.norm(self.evaluate(np.minimum(nodes, 1.0), 1), axis=-1)
        return table_s[span] + half * (speed @ GAUSS_WEIGHTS)

    def parameter(self, s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Parameters at arc lengths from the start [m], by Newton's method on `arc_length`."""
        table_u, table_s = self._length_table
        u = np.interp(s, table_s, table_u)
        piece = np.clip(np.searchsorted(table_s, s, side="right") - 1, 0, len(table_u) - 2)
        low, high = table_u[piece], table_u[piece + 1]
        for _ in range(4):
            # at a corner the curve may all but stand still, and Newton's step goes anywhere
            speed = np.maximum(np.linalg.norm(self.evaluate(u, 1), axis=-1), STILL)
            u = np.clip(u - (self.arc_length(u) - s) / speed, low, high)
        return u

    def with_weights(self, weights: Float[np.ndarray, "n"]) -> "Nurbs":
        """The curve of the same control vertices with other weights: drawn to the heavier ones, off
        the points.

        Raises:
            PlanningError: Not one positive weight a vertex (a closed curve's first three count
                once).
        """
        count = len(self.weights) - (DEGREE if self.closed else 0)
        checked = checked_weights(weights, count)
        return Nurbs(
            spline=homogeneous_spline(
                self.control_points[:count], checked, self.spline.t, self.closed
            ),
            closed=self.closed,
        )
