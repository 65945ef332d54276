"""The truth of a robot as a file."""

import numpy as np

from breastscan.run import parquet
from breastscan.run.columns import TRUTH
from sim.room.rigid_contacts import RigidContact
from sim.truth_log import TruthLog, TruthRecorder

PERIOD = 0.002


def test_the_truth_is_read_back_as_it_was_saved(tmp_path):
    recorder, X_SP = TruthRecorder(), np.diag([1.0, -1.0, -1.0, 1.0])
    for row in range(3):
        force_S = np.array([0.0, 0.1, row])
        recorder.add(PERIOD * row, np.full(6, float(row)), force_S, 1e-3 * row, X_SP, 1e-4 * row)
    recorder.add_rigid(touching(2, 12.0))
    log = recorder.log()
    log.save(tmp_path / "truth.parquet")
    for name, values in parquet.read(tmp_path / "truth.parquet", TRUTH).items():
        expected = getattr(log, name)
        if expected.dtype.kind == "U":
            assert values.tolist() == expected.tolist()
        else:
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)


def touching(row, force, of_arm="probe_hull", of_other="chest_hull"):
    chest_S = np.array([0.0, 0.0, force if of_other == "chest_hull" else 0.0])
    return RigidContact(PERIOD * row, chest_S, force, of_arm, of_other)


def recorded(rows=6):
    """A log in which the probe's body met the chest plate, and a link the table."""
    recorder = TruthRecorder()
    for row in range(rows):
        force_S = np.array([3.0, 0.0, 1.0 * row])
        recorder.add(PERIOD * row, np.full(6, 1.0 * row), force_S, 0.0, np.eye(4), 1e-4 * row)
        if row in (2, 3):
            recorder.add_rigid(touching(row, 10.0 * row))
        if row == 4:
            recorder.add_rigid(touching(row, 7.0, "link4_hull0", "table_hull"))
    return recorder


def require_same(log, other):
    for name, values in vars(log).items():
        np.testing.assert_array_equal(getattr(other, name), values, err_msg=name)


def test_the_force_on_the_body_is_the_tissues_and_the_chest_plates_together():
    log = recorded().log()
    np.testing.assert_array_equal(log.rigid_force, [0.0, 0.0, 20.0, 30.0, 7.0, 0.0])
    expected = np.hypot(3.0, [0.0, 1.0, 22.0, 33.0, 4.0, 5.0])
    np.testing.assert_allclose(log.force_any, expected)


def test_what_touched_hardest_is_told_with_both_parts_the_force_and_when():
    told = recorded().log().touched_else
    assert told == (
        "In the twin, the probe's body touched the chest plate, first at 0.004 s and hardest, with "
        "30.0 N, at 0.006 s of the robot's clock"
    )
    assert recorded(rows=2).log().touched_else is None


def test_links_are_told_by_their_number():
    recorder = recorded(rows=1)
    recorder.add_rigid(touching(0, 1.0, "link4_hull0", "post_hull"))
    assert "link 4 of the arm touched the camera stand's post" in str(recorder.log().touched_else)


def test_a_log_that_was_kept_goes_on_as_it_was(tmp_path):
    log = recorded().log()
    log.keep(tmp_path / "truth.npz")
    kept = TruthLog.load(tmp_path / "truth.npz")
    assert kept is not None
    require_same(log, kept)
    recorder = TruthRecorder()
    recorder.recall(kept)
    require_same(log, recorder.log())


def test_a_log_of_a_version_that_knew_less_is_none(tmp_path):
    log = recorded().log()
    known = {name: values for name, values in vars(log).items() if name != "rigid_force"}
    np.savez(tmp_path / "truth.npz", **known)
    assert TruthLog.load(tmp_path / "truth.npz") is None


def test_the_latest_rows_are_kept_with_what_touched_in_them():
    recorder = TruthRecorder()
    recorder.limit(2)
    for row in range(6):
        recorder.add(PERIOD * row, np.zeros(6), np.zeros(3), 0.0, np.eye(4), 0.0)
        if row in (0, 1, 5):
            recorder.add_rigid(touching(row, 1.0 + row))
    np.testing.assert_array_equal(recorder.log().rigid_force, [0.0, 6.0])
