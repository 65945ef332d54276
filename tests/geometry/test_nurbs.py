import itertools

import geomdl.NURBS
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize_scalar

from breastscan.errors import PlanningError
from breastscan.geometry.nurbs import Nurbs
from breastscan.geometry.nurbs_system import homogeneous_spline

BORDER = 1.0 - 1e-15
U = np.linspace(0.0, 1.0, 401)


def wavy_loop(count: int = 15, seed: int = 0) -> np.ndarray:
    angle = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    ring = np.stack(
        [0.060 * np.cos(angle), 0.073 * np.sin(angle), 0.003 * np.sin(3 * angle)], axis=1
    )
    return ring + np.random.default_rng(seed).normal(0.0, 1e-3, ring.shape)


def random_weights(count: int = 15) -> np.ndarray:
    return np.random.default_rng(1).uniform(0.1, 10.0, count)


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("weights", [None, random_weights()])
def test_curve_passes_every_point_within_a_picometre(closed, weights):
    points = wavy_loop()
    curve = Nurbs.interpolate(points, closed=closed, weights=weights)
    u = curve.breaks[:-1] if closed else curve.breaks
    np.testing.assert_allclose(curve.evaluate(u), points, atol=1e-12)


def test_closed_curve_equals_scipys_periodic_interpolant():
    points = wavy_loop()
    curve = Nurbs.interpolate(points)
    oracle = make_interp_spline(curve.breaks, np.vstack([points, points[:1]]), bc_type="periodic")
    for order in range(3):
        np.testing.assert_allclose(curve.evaluate(U, order), oracle(U, nu=order), atol=1e-10)


@pytest.mark.parametrize("weights", [None, random_weights()])
def test_tangent_and_curvature_match_at_the_seam(weights):
    curve = Nurbs.interpolate(wavy_loop(), weights=weights)
    assert relative_jump(curve.evaluate(np.array([0.0, BORDER]), 1)) < 1e-9
    assert relative_jump(curve.evaluate(np.array([0.0, BORDER]), 2)) < 1e-9
    assert relative_jump(curve.curvature(np.array([0.0, BORDER]))) < 1e-9


def relative_jump(before_after: np.ndarray) -> float:
    return float(
        np.linalg.norm(before_after[1] - before_after[0]) / np.linalg.norm(before_after[0])
    )


@settings(deadline=None, max_examples=25)
@given(st.integers(4, 40), st.integers(0, 10_000))
def test_any_closed_curve_is_twice_smooth_at_its_seam(count, seed):
    curve = Nurbs.interpolate(wavy_loop(count, seed))
    for order in (1, 2):
        assert relative_jump(curve.evaluate(np.array([0.0, BORDER]), order)) < 1e-9


@pytest.mark.parametrize("closed", [True, False])
def test_rational_curve_equals_geomdl(closed):
    curve = Nurbs.interpolate(wavy_loop(), closed=closed, weights=random_weights())
    oracle = geomdl.NURBS.Curve(normalize_kv=False)
    oracle.degree = 3
    oracle.ctrlpts = curve.control_points.tolist()
    oracle.weights = curve.weights.tolist()
    oracle.knotvector = curve.spline.t.tolist()
    for u in (0.0, 0.123, 0.5, 0.987):
        expected = np.array(oracle.derivatives(u, order=2))
        for order in range(3):
            np.testing.assert_allclose(
                curve.evaluate(u, order), expected[order], rtol=1e-8, atol=1e-9
            )


@pytest.mark.parametrize("weights", [None, random_weights()])
def test_derivatives_agree_with_finite_differences(weights):
    curve, step = Nurbs.interpolate(wavy_loop(), weights=weights), 1e-6
    u = np.linspace(0.01, 0.99, 57)
    for order in (1, 2):
        numeric = (curve.evaluate(u + step, order - 1) - curve.evaluate(u - step, order - 1)) / (
            2 * step
        )
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(curve.evaluate(u, order), numeric, atol=1e-4 * scale)


def test_open_curve_leaves_its_ends_along_the_parabola_through_the_outermost_points():
    points = np.stack([np.linspace(0.0, 0.1, 7), np.linspace(0.0, 0.1, 7) ** 2], axis=1)
    for weights in (None, random_weights(7)):
        ends = Nurbs.interpolate(points, closed=False, weights=weights).evaluate(
            np.array([0.0, 1.0]), 1
        )
        assert ends[0, 1] / ends[0, 0] == pytest.approx(0.0, abs=1e-3)
        assert ends[1, 1] / ends[1, 0] == pytest.approx(0.2, abs=1e-3)


def test_open_curve_solves_the_papers_equations():
    """Eqs. 19-22 written out, with chord-length knots and the sign of e_1 corrected."""
    points = wavy_loop(9)
    curve = Nurbs.interpolate(points, closed=False)
    n, delta = len(points) - 1, np.diff(curve.spline.t)
    first_tangent, last_tangent = curve.evaluate(np.array([0.0, 1.0]), 1)
    A, e = np.eye(n + 1), np.zeros((n + 1, 3))
    e[0] = points[0] + delta[3] / 3 * first_tangent
    e[n] = points[n] - delta[n + 2] / 3 * last_tangent
    for i in range(2, n + 1):
        before, after = (
            delta[i] + delta[i + 1] + delta[i + 2],
            delta[i + 1] + delta[i + 2] + delta[i + 3],
        )
        a = delta[i + 2] ** 2 / before
        b = (
            delta[i + 2] * (delta[i] + delta[i + 1]) / before
            + delta[i + 1] * (delta[i + 2] + delta[i + 3]) / after
        )
        c = delta[i + 1] ** 2 / after
        A[i - 1, i - 2 : i + 1] = a, b, c
        e[i - 1] = (delta[i + 1] + delta[i + 2]) * points[i - 1]
    vertices = np.vstack([points[:1], np.linalg.solve(A, e), points[-1:]])
    np.testing.assert_allclose(curve.control_points, vertices, atol=1e-12)


def test_circle_has_the_circles_length_and_curvature():
    angle = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    circle = Nurbs.interpolate(0.062 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    assert circle.length * 1e3 == pytest.approx(2 * np.pi * 62.0, abs=1e-3)
    np.testing.assert_allclose(circle.curvature(U) * 0.062, 1.0, atol=1e-2)


@pytest.mark.parametrize("weights", [None, random_weights()])
def test_arc_length_agrees_with_adaptive_quadrature_and_inverts(weights):
    curve = Nurbs.interpolate(wavy_loop(), weights=weights)
    speed = lambda u: float(np.linalg.norm(curve.evaluate(u, 1)))  # noqa: E731
    expected, _ = quad(
        speed, 0.0, 0.37, points=curve.breaks[curve.breaks < 0.37], epsabs=1e-12, limit=200
    )
    assert curve.arc_length(np.array([0.37]))[0] == pytest.approx(expected, abs=1e-9)
    s = np.linspace(0.0, curve.length, 50)
    np.testing.assert_allclose(curve.arc_length(curve.parameter(s)), s, atol=1e-12)


def test_polynomials_reproduce_the_curve():
    curve = Nurbs.interpolate(wavy_loop(), weights=random_weights())
    span = np.minimum(np.searchsorted(curve.breaks, U, side="right") - 1, len(curve.breaks) - 2)
    homogeneous = np.zeros((len(U), 4))
    for power in range(4):
        homogeneous = (
            homogeneous * (U - curve.breaks[span])[:, None] + curve.polynomials[span, power]
        )
    np.testing.assert_allclose(
        homogeneous[:, :3] / homogeneous[:, 3:], curve.evaluate(U), atol=1e-14
    )


def test_a_heavier_vertex_draws_the_curve_and_leaves_the_rest_alone():
    curve = Nurbs.interpolate(wavy_loop())
    weights = np.ones(len(wavy_loop()))
    weights[5] = 4.0
    heavier, vertex = curve.with_weights(weights), curve.control_points[5]
    before, after = (np.linalg.norm(c.evaluate(U) - vertex, axis=1).min() for c in (curve, heavier))
    assert after < before
    moved = np.linalg.norm(heavier.evaluate(U) - curve.evaluate(U), axis=1) > 1e-12
    knots = curve.spline.t
    assert U[moved].min() >= knots[5] - 1e-9
    assert U[moved].max() <= knots[5 + 4] + 1e-9


def test_parameters_of_another_curve_may_be_given():
    points, normals = wavy_loop(), wavy_loop(seed=4)
    curve = Nurbs.interpolate(points)
    companion = Nurbs.interpolate(normals, parameters=curve.breaks[:-1])
    np.testing.assert_allclose(companion.evaluate(curve.breaks[:-1]), normals, atol=1e-12)


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan])
def test_parameters_outside_the_curve_are_refused(value):
    with pytest.raises(PlanningError, match="must lie in"):
        Nurbs.interpolate(wavy_loop()).evaluate(np.array([0.5, value]))


def test_bad_points_are_named():
    points = wavy_loop()
    with pytest.raises(PlanningError, match="4 points or more, got 3"):
        Nurbs.interpolate(points[:3])
    with pytest.raises(PlanningError, match="points 4 and 5 are the same"):
        Nurbs.interpolate(np.insert(points, 5, points[4], axis=0))
    with pytest.raises(PlanningError, match="returns to its first point by itself"):
        Nurbs.interpolate(np.vstack([points, points[:1]]))
    points[7, 1] = np.nan
    with pytest.raises(PlanningError, match="point 7 is not finite"):
        Nurbs.interpolate(points)


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, np.inf])
def test_weights_that_are_not_positive_are_named(weight):
    weights = np.ones(15)
    weights[3] = weight
    with pytest.raises(PlanningError, match="weight of point 3"):
        Nurbs.interpolate(wavy_loop(), weights=weights)


def test_wrong_counts_are_refused():
    with pytest.raises(PlanningError, match="expected 15 weights"):
        Nurbs.interpolate(wavy_loop(), weights=np.ones(14))
    with pytest.raises(PlanningError, match="rising parameters"):
        Nurbs.interpolate(wavy_loop(), parameters=np.linspace(0.0, 1.0, 15))


def test_parameters_that_are_all_but_equal_are_refused():
    parameters = np.linspace(0.0, 1.0, 15, endpoint=False)
    parameters[1] = 1e-320
    with pytest.raises(PlanningError, match="all but equal"):
        Nurbs.interpolate(wavy_loop(), parameters=parameters)


def cubic(*vertices: tuple[float, float], weights: tuple[float, ...] = (1, 1, 1, 1)) -> Nurbs:
    """One span of four vertices."""
    knots = np.repeat([0.0, 1.0], 4)
    return Nurbs(
        spline=homogeneous_spline(np.array(vertices, float), np.array(weights), knots, False),
        closed=False,
    )


@pytest.mark.parametrize("off", [0.1, 1e-3, 1e-5, 1e-9, 0.0])
def test_the_length_of_a_curve_with_a_corner_is_scipys(off):
    """It all but stands still half-way."""
    curve = cubic((0, 0), (1 + off, 1), (0, 1), (1, 0))

    def speed(u: float) -> float:
        return float(np.linalg.norm(curve.evaluate(u, 1)))

    found = minimize_scalar(speed, bounds=(0.4, 0.6), method="bounded", options={"xatol": 1e-12})
    slowest = float(found.x)
    parts = np.unique(np.clip(slowest + np.outer([-1, 1], 0.6 * 0.5 ** np.arange(40)), 0, 1))
    pieces = [quad(speed, a, b, epsabs=1e-15)[0] for a, b in itertools.pairwise(parts)]
    assert curve.length == pytest.approx(sum(pieces), abs=1e-11)
    np.testing.assert_allclose(curve.arc_length(parts)[1:], np.cumsum(pieces), atol=1e-11)


@pytest.mark.parametrize("weight", [1e-4, 1e2, 1e4])
def test_the_length_of_a_heavily_weighted_curve_is_its_chords(weight):
    curve = cubic((0, 0), (0, 1), (1, 1), (1, 0), weights=(1, weight, 1, 1))
    close = np.append(0.0, np.geomspace(1e-9, 0.5, 400_001))
    u = np.append(close, 1 - close[-2::-1])
    chords = np.linalg.norm(np.diff(curve.evaluate(u), axis=0), axis=1)
    assert curve.length == pytest.approx(chords.sum(), rel=1e-8)


@pytest.mark.parametrize("off", [0.1, 1e-3, 1e-6])
def test_the_parameters_at_lengths_are_found_around_a_corner(off):
    curve = cubic((0, 0), (1 + off, 1), (0, 1), (1, 0))
    s = np.linspace(0, curve.length, 1001)
    u = curve.parameter(s)
    assert (np.diff(u) > 0).all()
    np.testing.assert_allclose(curve.arc_length(u), s, atol=1e-7)


@pytest.mark.parametrize("off", [1e-2, 1e-6, 0.0])
def test_where_the_curve_all_but_stands_still_is_a_corner(off):
    curve = cubic((0, 0), (1 + off, 1), (0, 1), (1, 0))
    u = np.linspace(0, 1, 200_001)
    slowest = u[np.argmin(np.linalg.norm(curve.evaluate(u, 1), axis=1))]
    assert np.abs(curve.corners - slowest).min() < 1e-5


@pytest.mark.parametrize(
    "curve", [Nurbs.interpolate(wavy_loop()), cubic((0, 0), (0.3, 0.5), (0.7, 0.5), (1, 0))]
)
def test_a_smooth_curve_has_no_corner(curve):
    assert not curve.corners.size
