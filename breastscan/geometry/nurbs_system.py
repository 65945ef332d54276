"""Knots and linear systems from which the control vertices of a cubic NURBS curve come [Zhang, Eqs.
17, 19-22].

`geometry.nurbs` is the curve itself; this module checks what it is made from, and solves for it.
"""

from typing import Any

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.sparse.linalg import splu

from breastscan.errors import PlanningError

DEGREE = 3
SAME_POINT = 1e-9
"""Distance of neighbours, as a fraction of the curve's size, below which they are one point."""


def interpolate_closed(points: np.ndarray, u: np.ndarray, weights: np.ndarray) -> BSpline:
    """Solve the cyclic system, homogeneously: N (w d) = (N w) p. Vertex i + 1 lies next to point
    i.
    """
    # the curve repeats with period 1: three spans are borrowed from either end
    breaks = np.append(u, 1.0)
    knots = np.concatenate([breaks[-1 - DEGREE : -1] - 1.0, breaks, breaks[1 : 1 + DEGREE] + 1.0])
    vertex_weights = np.roll(weights, 1)
    N = _cyclic_basis(u, knots)
    control = _solve(N, (N @ vertex_weights)[:, None] * points) / vertex_weights[:, None]
    return homogeneous_spline(control, vertex_weights, knots, closed=True)


def interpolate_open(points: np.ndarray, u: np.ndarray, weights: np.ndarray) -> BSpline:
    """Solve Eq. 21 with the tangents of Eq. 20 at the ends, where the two outermost vertices
    share a weight.
    """
    knots = np.concatenate([np.zeros(DEGREE), u, np.ones(DEGREE)])
    vertex_weights = np.concatenate([weights[:1], weights, weights[-1:]])
    N = BSpline.design_matrix(u, knots, DEGREE)
    slopes = sparse.csr_array(BSpline(knots, np.eye(len(vertex_weights)), DEGREE)(u[[0, -1]], nu=1))
    tangents = np.stack(
        [_parabola_slope(u[:3], points[:3]), _parabola_slope(u[:-4:-1], points[:-4:-1])]
    )
    goals = np.vstack([(N @ vertex_weights)[:, None] * points, weights[[0, -1], None] * tangents])
    control = _solve(sparse.csc_array(sparse.vstack([N, slopes])), goals) / vertex_weights[:, None]
    return homogeneous_spline(control, vertex_weights, knots, closed=False)


def homogeneous_spline(
    control: np.ndarray, weights: np.ndarray, knots: np.ndarray, closed: bool
) -> BSpline:
    """The spline of (w d, w); a closed one's first vertices are given once."""
    homogeneous = np.column_stack([control * weights[:, None], weights])
    if closed:
        homogeneous = np.vstack([homogeneous, homogeneous[:DEGREE]])
    extrapolate: Any = "periodic" if closed else False  # the stubs know only the flags
    return BSpline(knots, homogeneous, DEGREE, extrapolate=extrapolate)


def _parabola_slope(u: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivative at the first of three points of the parabola through them."""
    near, far = (points[1] - points[0]) / (u[1] - u[0]), (points[2] - points[1]) / (u[2] - u[1])
    return near - (far - near) * (u[1] - u[0]) / (u[2] - u[0])


def _solve(N: sparse.csc_array, goals: np.ndarray) -> np.ndarray:
    try:
        return splu(N).solve(goals)
    except RuntimeError as error:
        raise PlanningError(
            "the curve's equations are singular: some of its parameters are all but equal, so drop "
            "points there",
            goals,
        ) from error


def _cyclic_basis(u: np.ndarray, knots: np.ndarray) -> sparse.csc_array:
    """Basis functions at parameters u, where the last three of the periodic curve are the first
    three again.
    """
    N = BSpline.design_matrix(u, knots, DEGREE).tocoo()
    vertices = len(knots) - 2 * DEGREE - 1
    return sparse.csc_array((N.data, (N.row, N.col % vertices)), shape=(len(u), vertices))


def check_points(points: np.ndarray) -> None:
    """Raise a PlanningError where there are too few points, or one is not finite."""
    if len(points) <= DEGREE:
        raise PlanningError(
            f"a cubic curve needs 4 points or more, got {len(points)}: sample the path finer",
            points,
        )
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise PlanningError(
            f"point {bad} is not finite ({points[bad]}): drop it before the curve is made",
            points[bad],
        )


def chord_parameters(points: np.ndarray, closed: bool) -> np.ndarray:
    """Cumulative chord length over the whole [Zhang, Sec. IV-A; Eq. 19 prints uniform knots].

    Raises:
        PlanningError: Two neighbours are the same point.
    """
    ring = np.vstack([points, points[:1]]) if closed else points
    chords = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    bad = int(np.argmin(chords))
    if chords[bad] <= SAME_POINT * np.ptp(points, axis=0).max():
        after = (bad + 1) % len(points)
        cure = (
            "a closed curve returns to its first point by itself"
            if after == 0
            else "neighbours must differ"
        )
        raise PlanningError(f"points {bad} and {after} are the same: drop one, {cure}", points[bad])
    s = np.append(0.0, np.cumsum(chords))
    u = s / s[-1]
    return u[:-1] if closed else u


def checked_weights(weights: np.ndarray | None, count: int) -> np.ndarray:
    """The weights, 1 where none are given, or a PlanningError where they are not one positive
    number a point.
    """
    if weights is None:
        return np.ones(count)
    if len(weights) != count:
        raise PlanningError(f"expected {count} weights, one a point, got {len(weights)}", weights)
    good = np.isfinite(weights) & (weights > 0.0)
    if not good.all():
        bad = int(np.argmin(good))
        raise PlanningError(
            f"the weight of point {bad} must be positive and finite, got {weights[bad]}",
            weights[bad],
        )
    return weights


def checked_parameters(u: np.ndarray, count: int, closed: bool) -> np.ndarray:
    """The parameters, or a PlanningError where they do not rise from 0 to the curve's end, one a
    point.
    """
    ends = u[0] == 0.0 and (u[-1] < 1.0 if closed else u[-1] == 1.0)
    if len(u) != count or not ends or not (np.diff(u) > 0.0).all():
        raise PlanningError(
            f"expected {count} rising parameters from 0 to {'below 1' if closed else '1'}, one a "
            f"point, got {u}",
            u,
        )
    return u
