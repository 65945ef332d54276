"""What a log says, on one that was made by hand."""

import math

import numpy as np
import pytest

from breastscan import scan_log
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion
from breastscan.run import metrics
from breastscan.run.trajectory import Sample
from tests.springs import X_FP, SpringRobot


def sample(phase, row, time=0.0):
    return Sample(time, phase, row, np.full(6, 0.1), np.zeros(6), np.zeros(6), np.zeros(6), False)


MOTION = Motion(
    q=np.outer(np.arange(3.0), np.ones(6)),
    qd=np.zeros((3, 6)),
    s=np.array([0.0, 1.0, 4.0]),
    q_approach=np.zeros(6),
    clearance=0.03,
)


def test_the_plan_stands_beside_the_measurement_between_its_rows_and_is_nan_off_the_path():
    log = [sample("approach", math.nan), sample("loop", 0.25), sample("loop", 2.0)]
    table = scan_log.trajectory(log, MOTION, SpringRobot(np.zeros(6), 0.0))
    np.testing.assert_array_equal(table.s, [math.nan, 0.25, 4.0])
    np.testing.assert_array_equal(table.q_plan[:, 0], [math.nan, 0.25, 2.0])
    X_BP = KinematicCalibration.nominal().forward(np.full(6, 0.1)) @ X_FP
    np.testing.assert_allclose(table.X_BP[1], X_BP)


def test_the_last_row_is_the_farthest_on_the_path():
    assert scan_log.last_row([]) == 0
    log = [sample("loop", 7.9), sample("lift", math.nan), sample("resume", 5.0)]
    assert scan_log.last_row(log) == 7


def test_contact_is_made_again_the_overlap_before_where_it_ended():
    s = np.linspace(0.0, 0.1, 1001)
    assert scan_log.resumption_row([], s) == 0
    assert scan_log.resumption_row([sample("approach", math.nan)], s) == 0
    assert scan_log.resumption_row([sample("loop", 80.0)], s) == 0
    at = scan_log.resumption_row([sample("loop", 500.5)], s)
    assert s[500] - s[at] == pytest.approx(scan_log.OVERLAP_LENGTH, abs=1e-4)


def test_a_resumed_scan_is_one_table_in_which_each_place_of_the_loop_counts_once():
    """And time goes on where a controller's clock began anew."""
    first = [sample("loop", 0.0, 8.0), sample("loop", 1.2, 8.5), sample("retreat", math.nan, 9.0)]
    second = [
        sample("resume", 1.0, 0.5),
        sample("loop", 1.0, 1.0),
        sample("loop", 1.2, 1.5),
        sample("loop", 1.3, 2.0),
    ]
    robot = SpringRobot(np.zeros(6), 0.0)
    table = scan_log.trajectory(first + second, MOTION, robot)
    assert table.phase == ("loop", "loop", "retreat", "resume", "overlap", "overlap", "loop")
    assert table.s[3] == 1.0
    later = 9.0 + robot.period + np.array([0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(table.t, [8.0, 8.5, 9.0, *later])
    times = [(float(part[0]), float(part[-1])) for part in table.parts()]
    assert times == [(8.0, 9.0), (table.t[3], table.t[-1])]
    running_on = [entry._replace(time=entry.time + 30.0) for entry in second]
    table = scan_log.trajectory(first + running_on, MOTION, robot)
    np.testing.assert_array_equal(table.t[3:], [30.5, 31.0, 31.5, 32.0])
    error_free = metrics.of_execution(table, 0.0, 1.5)
    assert error_free["scan_time_s"] == pytest.approx(1.0 + 1.5)
    assert error_free["realtime_factor"] == pytest.approx(1.0)
