"""What is told of an execution, also of one that ended early; a whole one is held to its bars in
tests/commands.
"""

from dataclasses import replace

import numpy as np
import pytest

from sim import error_analysis
from sim.error_analysis import REPLAY_STEP, STEADY_AFTER
from sim.room.rigid_contacts import RigidContact
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
