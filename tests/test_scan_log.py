"""What a log says, on one that was made by hand."""

import math

import numpy as np

from breastscan import scan_log
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion
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


def test_the_last_row_is_the_latest_on_the_path():
    assert scan_log.last_row([]) == 0
    assert scan_log.last_row([sample("loop", 7.9), sample("lift", math.nan)]) == 7
