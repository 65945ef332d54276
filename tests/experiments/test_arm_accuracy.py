import numpy as np

from experiments import arm_accuracy
from sim.scene import HOME_Q
from sim.wrist.probe import tip_pose


def test_reading_the_calibration_takes_nine_tenths_of_the_error_out():
    q = HOME_Q + np.linspace(-0.3, 0.3, 5)[:, None] * np.array([1.0, 0.5, -0.5, 0.5, 0.2, 1.0])
    unread, read = (
        arm_accuracy.along(q, tip_pose(np.pi / 4), kind, 0)
        for kind in ("uncalibrated", "calibrated")
    )
    assert 1e-3 < unread.position.mean() < 3e-3
    assert 0.05 < read.position.mean() / unread.position.mean() < 0.15
    assert np.degrees(unread.tilt.mean()) < 0.3
