"""Free ways of the arm: around what stands there, never through it."""

import itertools

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.hulls import Shape
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.clearance import Clearance
from breastscan.planning.free_way import MARGIN, gap_of, way

LIMITS = np.full(6, 2 * np.pi)
LEFT, RIGHT = (
    np.array([side, -1.6, 1.6, -1.57, -1.57, 0.0]) for side in (-0.9, 0.9)
)  # fmt: skip
"""The arm reaches out, to either side."""


def gap_with(*room):
    return gap_of(Clearance((), room), KinematicCalibration.nominal())


def post(height=1.2):
    """Between both sides, where the arm would swing through."""
    reach = kinematics.forward((LEFT + RIGHT) / 2)[:3, 3]
    middle = np.array([reach[0], reach[1], height / 2])
    size = (0.04, 0.04, height / 2)
    return Shape(name="post", kind="box", size=size, X=se3.pose(np.eye(3), middle))


def looked_at(places):
    """Every 5 mrad of the way."""
    pieces = [
        np.linspace(a, b, int(np.abs(b - a).max() / 0.005) + 2)
        for a, b in itertools.pairwise(places)
    ]
    return np.concatenate(pieces)


def test_where_nothing_stands_the_way_is_straight():
    assert way(LEFT, RIGHT, gap_with(), LIMITS) == ()


def test_a_post_in_the_way_is_gone_around_with_its_margin():
    gap = gap_with(post())
    straight = looked_at([LEFT, RIGHT])
    assert gap(straight).min() < 0
    via = way(LEFT, RIGHT, gap, LIMITS)
    assert len(via) >= 1
    along = looked_at([LEFT, *via, RIGHT])
    assert gap(along).min() > MARGIN - 0.004  # between looks the arm comes nearer by millimetres
    assert np.abs(along).max() < LIMITS[0]


def test_the_way_back_is_found_as_well_and_both_are_short():
    gap = gap_with(post())
    for begin, end in ((LEFT, RIGHT), (RIGHT, LEFT)):
        places = [begin, *way(begin, end, gap, LIMITS), end]
        length = sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(places))
        assert length < 2.5 * np.linalg.norm(end - begin)


def test_the_same_way_is_found_again():
    gap = gap_with(post())
    np.testing.assert_array_equal(way(LEFT, RIGHT, gap, LIMITS), way(LEFT, RIGHT, gap, LIMITS))


def test_a_way_that_begins_near_something_may():
    """The lifted probe can be nearer to the chest than the margin of a way."""
    beside = kinematics.forward(LEFT)[:3, 3] + np.array([0.0, -0.106, 0.0])
    near = Shape(name="near", kind="box", size=(0.05, 0.05, 0.05), X=se3.pose(np.eye(3), beside))
    gap = gap_with(near)
    assert 0 < gap(LEFT[None])[0] < MARGIN
    assert gap(looked_at([LEFT, *way(LEFT, RIGHT, gap, LIMITS), RIGHT])).min() > 0


def test_where_there_is_no_way_the_arm_is_not_sent(monkeypatch):
    monkeypatch.setattr("breastscan.planning.free_way.TRIES", 60)
    with pytest.raises(PlanningError, match="no way clear of body, arm and room"):
        way(LEFT, RIGHT, lambda q: np.where(np.abs(q[:, 0]) < 0.3, -1.0, 1.0), LIMITS)
