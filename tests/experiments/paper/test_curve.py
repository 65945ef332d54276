"""The figures given for curve and interpolation are those that other ways of reckoning give."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from breastscan.geometry.nurbs import Nurbs
from breastscan.report.paper import TABLE4_THEORETICAL_MM
from experiments.paper import curve


@pytest.fixture(scope="module")
def items():
    return {item.heading: item for item in curve.items()}


def values(item, name):
    return next(v for column, v in item.data.items() if column.name == name)


def test_a_square_turns_by_right_angles_and_its_centre_is_half_a_side_away():
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    np.testing.assert_allclose(curve.turns_deg(square), 90.0)
    p = np.array([[1.0, 1.0, 0.0], [3.0, 3.0, 0.0]])
    np.testing.assert_allclose(curve.distance_to_polygon(p, square), [1.0, np.sqrt(2.0)])


def test_the_cyclic_curve_has_no_corner_where_it_closes_and_the_clamped_one_has():
    assert curve.seam_turn_deg(Nurbs.interpolate(TABLE4_THEORETICAL_MM)) < 1e-3
    assert curve.seam_turn_deg(curve.clamped(TABLE4_THEORETICAL_MM)) > 5.0


def test_the_drawn_curve_is_the_periodic_spline_through_table_4(items):
    """SciPy's, at cumulative chord length."""
    ring = np.vstack([TABLE4_THEORETICAL_MM, TABLE4_THEORETICAL_MM[:1]])
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1)))
    spline = CubicSpline(s / s[-1], ring, bc_type="periodic")
    u = values(items["Fig. 18"], "u")
    drawn = np.stack([values(items["Fig. 18"], f"{axis}_mm") for axis in "xyz"], axis=1)
    np.testing.assert_allclose(drawn, spline(u), atol=1e-9)
    first, second = spline(u, 1), spline(u, 2)
    bend = np.linalg.norm(np.cross(first, second), axis=1) / np.linalg.norm(first, axis=1) ** 3
    np.testing.assert_allclose(values(items["Fig. 18"], "radius_mm"), 1.0 / bend, rtol=1e-6)
    assert 1.0 / bend.max() == pytest.approx(27.7, abs=0.05)


def test_the_interpolated_points_keep_the_papers_speed_and_acceleration(items):
    t, s = values(items["Fig. 15"], "t_s"), values(items["Fig. 15"], "s_mm")
    speed = np.diff(s) / np.diff(t)
    assert speed.max() <= 25.0 + 1e-6
    assert np.abs(np.diff(speed) / np.diff(t[:-1])).max() <= 20.0 + 1e-3
    assert "smallest radius is 27.7 mm" in items["Fig. 15"].why
