"""Which ways lead to strokes, between them and home, and which strokes none does."""

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.geometry import se3
from breastscan.geometry.hulls import Shape
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import ways
from breastscan.planning.clearance import Clearance
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.fitting import Task
from breastscan.planning.free_way import gap_of
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.motion import Motion
from tests.planning.test_free_way import LEFT, RIGHT, looked_at, post

HOME = np.array([0.0, -2.4, 1.9, -1.57, -1.57, 0.0])
X_FP = se3.pose(np.eye(3), np.array([0.0, 0.0, 0.05]))


def stroke(q_begin, turn=0.1):
    """A few rows, joint 1 turning."""
    q = q_begin + np.linspace(0.0, turn, 20)[:, None] * np.eye(6)[0]
    s = np.linspace(0.0, 0.05, 20)
    return Motion(q=q, qd=np.zeros_like(q), s=s, q_approach=q[0], clearance=0.03)


def task(*room):
    clearance = Clearance((), room) if room else None
    return Task(
        X_FP=X_FP, period=0.002, limits=FeedrateLimits(), config=JointPathConfig(),
        clearance=clearance,
    )  # fmt: skip


def far(height=0.2):
    """Something that is never in the way."""
    return Shape(
        name="far", kind="box", size=(0.1, 0.1, height), X=se3.pose(np.eye(3), np.full(3, 5.0))
    )


def places(whole):
    """Home, every via, every lifted end, home."""
    arm = KinematicCalibration.nominal()
    found = [HOME]
    for k, (first, last) in enumerate(zip(whole.starts, whole.lasts, strict=True)):
        found += [*whole.ways[k], whole.lifted(first, X_FP, arm), whole.lifted(last, X_FP, arm)]
    return [*found, *whole.ways[-1], HOME]


def test_where_nothing_stands_all_ways_are_straight():
    whole, kept = ways.connected([stroke(LEFT), stroke(RIGHT)], task(far()), HOME)
    assert kept == [0, 1]
    assert whole.ways == ((), (), ())
    assert whole.starts == (0, 20)


def test_without_a_clearance_strokes_are_joined_as_they_are():
    whole, kept = ways.connected([stroke(LEFT), stroke(RIGHT)], task(), HOME)
    assert kept == [0, 1]
    assert not any(whole.ways)


def test_what_stands_between_two_strokes_is_gone_around():
    room = post()
    whole, kept = ways.connected([stroke(LEFT), stroke(RIGHT)], task(room), HOME)
    assert kept == [0, 1]
    assert whole.ways[1]
    gap = gap_of(Clearance((), [room]), KinematicCalibration.nominal())
    assert gap(looked_at(places(whole))).min() > 0.005


def test_joints_are_turned_to_where_the_way_from_home_is_short():
    """A stroke whose wrist was planned a whole rotation away."""
    away = stroke(LEFT + 2 * np.pi * np.eye(6)[5])
    whole, _ = ways.connected([away], task(far()), HOME)
    np.testing.assert_allclose(whole.q, stroke(LEFT).q, atol=1e-12)
    np.testing.assert_allclose(whole.q_approach, LEFT, atol=1e-12)


def test_a_stroke_in_which_the_arm_is_shut_in_is_left_out(monkeypatch):
    """Walls to both sides of the middle stroke, up to where no joint 1 gets past them."""
    monkeypatch.setattr("breastscan.planning.free_way.TRIES", 40)
    monkeypatch.setattr(
        ways.free_way, "gap_of",
        lambda clearance, arm: lambda q: np.where(np.abs(np.abs(q[:, 0]) - 1.5) < 0.1, -1.0, 1.0),
    )  # fmt: skip
    shut_in = stroke(LEFT + np.array([-1.1, 0, 0, 0, 0, 0]))
    strokes = [stroke(LEFT), shut_in, stroke(RIGHT)]
    whole, kept = ways.connected(strokes, task(far()), HOME)
    assert kept == [0, 2]
    assert len(whole.ways) == 3
    with pytest.raises(PlanningError, match="no way clear of body, arm and room"):
        ways.connected([shut_in], task(far()), HOME)


def test_an_arm_that_stands_elsewhere_comes_to_its_stroke_around_what_stands_there():
    room = post()
    whole, _ = ways.connected([stroke(LEFT), stroke(RIGHT)], task(room), HOME)
    entered = ways.entered(whole, task(room), 1, LEFT)
    assert entered.ways[0] == whole.ways[0]
    assert entered.ways[1]
    gap = gap_of(Clearance((), [room]), KinematicCalibration.nominal())
    above = whole.lifted(whole.starts[1], X_FP, KinematicCalibration.nominal())
    assert gap(looked_at([LEFT, *entered.ways[1], above])).min() > 0.005
