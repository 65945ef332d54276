"""Errors of several calibrations make a rig as one calibration's do."""

import cv2
import numpy as np
import pytest

from breastscan.geometry import se3
from breastscan.vision.camera import StereoRig
from experiments.budget.design import SPEC, TRUE_RIG
from experiments.budget.rigs import MEASURED_B, composed, exact_poses

CELLS = [SPEC.parent / "cells" / f"{number}.yaml" for number in range(10)]
CLOSE = 1e-7
"""What the search for a pose leaves [m, rad]."""


def lenses(rig):
    return rig.left, rig.right


def differs(rig, other):
    """Largest difference of lenses [px], of the relative pose and of the place [m, rad]."""
    return [
        max(np.abs(a.K - b.K).max() for a, b in zip(lenses(rig), lenses(other), strict=True)),
        np.abs(rig.X_RL - other.X_RL).max(),
        np.abs(rig.X_BL - other.X_BL).max(),
    ]


def error_mm(rig):
    """Of points about the breast that the true cameras see, triangulated by OpenCV."""
    true = StereoRig.load(TRUE_RIG)
    X_LB = se3.inverse(true.X_BL)
    seen = []
    for own, camera, X_CB in zip(lenses(rig), lenses(true), (X_LB, true.X_RL @ X_LB), strict=True):
        turn = cv2.Rodrigues(X_CB[:3, :3])[0]
        image = cv2.projectPoints(MEASURED_B, turn, X_CB[:3, 3], camera.K, camera.distortion)[0]
        seen.append(cv2.undistortPoints(image, own.K, own.distortion)[:, 0].T)
    points = cv2.triangulatePoints(np.eye(4)[:3], rig.X_RL[:3], *seen)
    points_B = se3.transform(rig.X_BL, (points[:3] / points[3]).T)
    return 1e3 * np.sqrt(np.mean(np.sum((points_B - MEASURED_B) ** 2, axis=1)))


def test_without_errors_it_is_the_true_rig():
    rig = composed(TRUE_RIG, TRUE_RIG, TRUE_RIG, TRUE_RIG)
    assert max(differs(rig, StereoRig.load(TRUE_RIG))) < CLOSE
    assert error_mm(rig) < 1e-3


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: cell.stem)
def test_the_errors_of_one_calibration_give_its_rig(cell):
    assert max(differs(composed(TRUE_RIG, cell, cell, cell), StereoRig.load(cell))) < CLOSE


@pytest.mark.parametrize("number", range(10))
def test_the_errors_of_three_give_a_rig_that_is_as_good_as_one_calibrations(number):
    files = [CELLS[(number + step) % 10] for step in (0, 3, 6)]
    of_one = [error_mm(StereoRig.load(cell)) for cell in CELLS]
    assert error_mm(composed(TRUE_RIG, *files)) < 1.5 * max(of_one)


@pytest.mark.parametrize(
    ("part", "changed"),
    [(0, [True, True, True]), (1, [False, True, False]), (2, [False, False, True])],
)
def test_each_part_changes_what_is_found_with_it_and_errs_less_than_a_calibration(part, changed):
    cell = CELLS[4]
    rig = composed(TRUE_RIG, *(cell if own == part else TRUE_RIG for own in range(3)))
    assert [difference > CLOSE for difference in differs(rig, StereoRig.load(TRUE_RIG))] == changed
    assert error_mm(rig) < 0.15


def test_exact_measurements_find_the_true_poses_with_the_true_lenses():
    true = StereoRig.load(TRUE_RIG)
    found = exact_poses(true, true)
    np.testing.assert_allclose(found.X_RL, true.X_RL, atol=CLOSE)
    np.testing.assert_allclose(found.X_BL, true.X_BL, atol=CLOSE)
