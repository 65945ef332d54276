"""In which pieces and in which order strokes are planned, with an arm that is told what it can
follow.
"""

from itertools import pairwise

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.planning import coverage, examination
from breastscan.planning.coverage import CoverageConfig
from breastscan.planning.examination import SHORTEST, Coverage
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.fitting import Fitted, Task
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.roll_graph import BlockedError
from tests.planning.test_coverage import PATCH, band, polar


class Piece(Fitted):
    """Stands for a planned piece: where it runs, and from where it was asked to begin."""

    def __init__(self, path, q_before):
        vars(self).update(path=path, q_before=q_before)

    @property
    def motion(self):
        return self

    @property
    def q(self):
        """The tip's place stands for the arm's posture."""
        return np.pad(self.path.points_B, ((0, 0), (0, 3)))

    @property
    def height(self):
        return self.path.points_B[:, 2].min()


@pytest.fixture
def arm(monkeypatch):
    """What it follows: everything, but what a test has it refuse."""
    refused = []

    def fitted(path, task):
        for refuse in refused:
            refuse(path)
        return Piece(path, task.q_before)

    monkeypatch.setattr(examination, "_fitted", fitted)
    return refused


def fitted(*, twice=False):
    config, lain = CoverageConfig(twice=twice), band()
    tracks = coverage.tracks("loops", lain, 0.02, twice=twice)
    plan = Coverage(kind="loops", config=config, patch=PATCH, band=lain, tracks=tracks)
    task = Task(X_FP=np.eye(4), period=0.002, limits=FeedrateLimits(), config=JointPathConfig())
    return plan.fitted(lambda path: path, task, lambda fraction: None)


def blocked_at(share, *, low):
    """Refuses the lowest loops, or the rest of them, from a share of their length on."""

    def refuse(path):
        if (polar(path.points_B).mean() > 1.2) == low and path.curve.length > 0.3:
            error = BlockedError("no way", 1)
            error.reached = share
            raise error

    return refuse


def test_strokes_go_from_the_chest_up_each_from_where_the_one_before_ended(arm):
    pieces = fitted()
    heights = [piece.height for piece in pieces]
    assert heights == sorted(heights)
    assert len(pieces) >= 4
    for before, piece in pairwise(pieces[1:]):
        np.testing.assert_array_equal(piece.q_before, before.q[-1])


def test_the_first_stroke_is_planned_towards_the_second_its_nearest_piece_last(arm):
    arm.append(blocked_at(0.4, low=True))
    first, second, third, *_ = fitted()
    assert first.height == pytest.approx(second.height, abs=1e-3)
    assert third.height > second.height + 5e-3
    np.testing.assert_array_equal(second.q_before, third.q[0])
    np.testing.assert_array_equal(first.q_before, second.q[-1])


def test_a_way_back_follows_the_way_there(arm):
    pieces = fitted(twice=True)
    for k in (0, -2):
        there, back = pieces[k], pieces[k + 1]
        np.testing.assert_allclose(there.path.points_B, back.path.points_B[::-1], atol=1e-9)


def test_what_is_shorter_than_a_touch_is_worth_is_left_out(arm):
    arm.append(blocked_at(0.0, low=True))
    lengths = [piece.path.curve.length for piece in fitted()]
    assert min(lengths) > SHORTEST


def test_an_arm_that_follows_nothing_says_why(arm):
    def refuse(path):
        error = BlockedError("the table is in the way", 1)
        error.reached = 0.0
        raise error

    arm.append(refuse)
    with pytest.raises(PlanningError, match="the table is in the way"):
        fitted()
