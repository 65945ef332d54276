"""What is told of an execution, also of one that ended early; a whole one is held to its bars in
tests/commands.
"""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from breastscan.vision.camera import RectifiedPair, StereoRig
from sim import error_analysis
from sim.error_analysis import REPLAY_STEP, STEADY_AFTER, ContactPlaces
from sim.room.rigid_contacts import RigidContact
from sim.tissue.phantom import Phantom, PhantomConfig
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


@pytest.mark.parametrize("centre_px", [(40.3, 29.8), (5.0, 62.0)], ids=["whole", "cut off"])
def test_pixels_that_both_cameras_see_are_found_among_all(centre_px):
    """As rays through every pixel find them, not only those near the breast."""
    phantom = Phantom(PhantomConfig())
    truth, size = Truth(phantom, Mock()), (60, 80)
    image = np.zeros(size, np.uint8)
    R_LV = Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix()
    pair = RectifiedPair(
        left=image, right=image, focal_px=220.0, centre_px=centre_px, baseline=0.06, R_LV=R_LV
    )  # fmt: skip
    X_SL = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.02, 0.01, 0.45]))
    X_RL = se3.pose(np.eye(3), np.array([-0.2, 0.0, 0.0]))
    v, u = np.indices(size).reshape(2, -1)
    rays_V = np.column_stack([u - centre_px[0], v - centre_px[1], np.full(v.size, 220.0)])
    hits_S = truth.cast(X_SL[:3, 3], rays_V @ (X_SL[:3, :3] @ R_LV).T)
    expected = np.isfinite(hits_S[:, 0])
    expected[expected] = truth.visible(hits_S[expected], (X_SL @ se3.inverse(X_RL))[:3, 3])
    seen = error_analysis.seen_by_both(pair, Mock(spec=StereoRig, X_RL=X_RL), X_SL, truth)
    assert expected.any()
    np.testing.assert_array_equal(seen.ravel(), expected)
