"""The pose that is sent, against SciPy's rotations."""

import numpy as np
from scipy.spatial.transform import Rotation

from breastscan.control import selection
from breastscan.geometry import se3


def test_the_selection_moves_along_the_axis_and_turns_about_the_tip():
    rng = np.random.default_rng(0)
    X_BP = se3.from_rotation_vector(rng.normal(size=3), rng.normal(size=3))
    X_sent = selection.corrected(X_BP, 0.006, 0.1, -0.05)
    np.testing.assert_allclose(X_sent[:3, 3], X_BP[:3, 3] + 0.006 * X_BP[:3, 2], atol=1e-15)
    turned = Rotation.from_matrix(X_BP[:3, :3]) * Rotation.from_euler("XYZ", [0.1, -0.05, 0.0])
    np.testing.assert_allclose(X_sent[:3, :3], turned.as_matrix(), atol=1e-15)


def test_what_lies_along_the_axis_of_a_shift_is_left_to_the_force():
    rng = np.random.default_rng(1)
    X_BP = se3.from_rotation_vector(rng.normal(size=3), rng.normal(size=3))
    shift_B = rng.normal(size=3)
    X_moved = selection.moved_across(X_BP, shift_B)
    np.testing.assert_array_equal(X_moved[:3, :3], X_BP[:3, :3])
    moved_P = X_BP[:3, :3].T @ (X_moved[:3, 3] - X_BP[:3, 3])
    np.testing.assert_allclose(moved_P, [*(X_BP[:3, :3].T @ shift_B)[:2], 0.0], atol=1e-15)
