"""What is told of an execution, also of one that ended early; a whole one is held to its bars in
tests/commands.
"""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from sim import error_analysis
from sim.error_analysis import REPLAY_STEP, STEADY_AFTER, ContactPlaces
from sim.room.rigid_contacts import RigidContact
from sim.truth import Truth
from sim.truth_log import TruthRecorder
from tests.run.synthetic_run import synthetic_log

AMPLITUDE = 0.004
"""Of the chest [m]."""


@pytest.fixture(scope="module")
def trajectory():
    return synthetic_log(np.random.default_rng(0))


@pytest.fixture(scope="module")
def truth(trajectory):
    """Of a robot that was on before the scan began and after it ended; its probe's body touches the
    chest once.
    """
    recorder, period = TruthRecorder(), trajectory.t[1] - trajectory.t[0]
    early = trajectory.t[:50] - 50 * period
    late = trajectory.t[-1] + period * np.arange(1, 51)
    for time in np.concatenate([early, trajectory.t, late]).tolist():
        rise = AMPLITUDE * (1 - np.cos(2 * np.pi * time / 4.0))
        recorder.add(time, np.zeros(6), np.zeros(3), 0.0, np.eye(4), rise)
        if time == late[4]:
            recorder.add_rigid(RigidContact(time, np.zeros(3), 1.0, "probe_hull", "chest_hull"))
    return recorder.log()


def test_the_chests_amplitude_is_half_its_stroke_during_the_loop(trajectory, truth):
    told = error_analysis.breathing_metrics(trajectory, truth)
    assert told["breathing_amplitude_mm"] == pytest.approx(1e3 * AMPLITUDE, abs=1e-3)
    held = replace(truth, rise=np.full(len(truth.time), 0.003))
    assert error_analysis.breathing_metrics(trajectory, held)["breathing_amplitude_mm"] == 0.0


def test_rows_off_the_loop_are_all_but_the_loops_and_the_hardest_touch(trajectory, truth):
    rows = error_analysis.rows_off_loop(trajectory, truth)
    on_loop = error_analysis.matching_rows(trajectory, truth)[trajectory.in_loop]
    assert not np.isin(rows, on_loop).any()
    off_loop = len(truth.time) - len(on_loop)
    assert len(rows) == pytest.approx(off_loop / REPLAY_STEP, abs=3)
    hardest = int(truth.rigid_force.argmax())
    assert hardest % REPLAY_STEP != 0
    assert hardest in rows


def test_a_loop_that_ends_before_it_is_steady_has_no_extremes(trajectory):
    first = int(np.flatnonzero(trajectory.in_loop)[0])
    rows = round(STEADY_AFTER / (trajectory.t[1] - trajectory.t[0]))
    short = trajectory.take(np.arange(first + rows - 10))
    told = error_analysis.force_metrics(short, 5.0)
    assert set(told) == {"contact_fraction", "indentation_max_mm"}
    longer = trajectory.take(np.arange(first + rows + 10))
    assert "force_peak_n" in error_analysis.force_metrics(longer, 5.0)


def test_the_nearest_point_of_a_loop_lies_on_its_sides():
    """Of a unit square: beside a side its foot, beyond a corner the corner, and the side that
    closes the loop counts.
    """
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    p = np.array([[0.3, -0.2, 0.1], [1.4, 1.3, 0.0], [-0.5, 0.6, 0.2], [0.5, 0.9, 0.0]])
    expected = [[0.3, 0, 0], [1, 1, 0], [0, 0.6, 0], [0.5, 1, 0]]
    np.testing.assert_allclose(error_analysis.nearest_on_loop(p, square), expected, atol=1e-15)


def test_the_whole_chains_error_is_the_distance_to_the_loop_between_its_points():
    """A ring of radius 1, sampled so coarsely that its corners are .1 apart: points of its sides
    are no error, and one beside it is off by as much.
    """
    azimuth = 2 * np.pi * np.arange(60) / 60
    ring = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    ring_truth = Mock(spec=Truth)
    ring_truth.level_loop.return_value = ring

    def told(p_S: np.ndarray) -> dict:
        places = ContactPlaces(rows=np.arange(len(p_S)), p_S=p_S, tilt=np.zeros(len(p_S)))
        return error_analysis.execution_metrics(places, np.eye(4), ring_truth, 0.5)

    on_sides = (0.7 * ring + 0.3 * np.roll(ring, -1, axis=0))[::7]
    assert told(on_sides)["executed_truth_rms_mm"] < 1e-9
    above = told(on_sides + np.array([0.0, 0.0, 0.002]))
    assert above["executed_truth_rms_mm"] == pytest.approx(2.0)
    assert above["executed_truth_mean_abs_mm"] == pytest.approx([0.0, 0.0, 2.0], abs=1e-9)
