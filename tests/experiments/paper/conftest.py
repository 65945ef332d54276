"""What the items are made from, without a camera: corners by projection; and a scan of a print."""

from dataclasses import replace

import numpy as np
import pytest

from breastscan.camera.interface import StereoPair
from breastscan.geometry import se3
from breastscan.vision import calibration as calibrating
from breastscan.vision.hand_eye import hand_eye as placing
from experiments.paper import calibration, hand_eye, scans
from tests.vision.board_shots import BOARD, SIZE, flange_poses, make_rig, poses_in_view, shots_of

X_FBoard = se3.from_rotation_vector(np.array([0.02, -0.01, 0.3]), np.array([-0.27, -0.05, 0.12]))


@pytest.fixture(scope="session")
def calibrated() -> calibration.Calibrated:
    rig = make_rig()
    X_LBoard = poses_in_view(rig, 20, np.random.default_rng(0))
    shots = shots_of(rig, X_LBoard, np.random.default_rng(1))
    grey = np.tile(np.linspace(40, 220, SIZE[0]).astype(np.uint8), (SIZE[1], 1))
    return calibration.Calibrated(
        shown=len(shots),
        pair=StereoPair(left=grey, right=grey, time=0.0),
        found=tuple(shots),
        result=calibrating.calibrate(shots, SIZE, BOARD),
        truth=rig,
        corner_errors_px=calibration.corner_errors_px(rig, X_LBoard, shots, BOARD),
    )


@pytest.fixture(scope="session")
def placed() -> hand_eye.Placed:
    rig = make_rig()
    X_BF = flange_poses(rig, X_FBoard, 20, np.random.default_rng(0))
    assert rig.X_BL is not None
    X_LBoard = se3.inverse(rig.X_BL) @ X_BF @ X_FBoard
    shots = shots_of(rig, X_LBoard, np.random.default_rng(1))
    return hand_eye.Placed(
        poses=len(shots),
        result=placing(shots, X_BF, replace(rig, X_BL=None), BOARD),
        truth=rig,
        pictures=[np.zeros(SIZE[::-1], np.uint8)] * hand_eye.SHOWN,
        shown=[0, 5, 10, 15],
    )


@pytest.fixture(scope="session")
def scan() -> scans.Scanned:
    return scans.scanned(scans.EXACT, scans.FORCES[0], seed=0)
