"""Errors along the path, read from a log whose errors are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.run.trajectory import Trajectory
from tests.run.synthetic_run import INDENTATION, PERIOD, SLIP, synthetic_log, write_run


def test_the_error_along_the_normal_is_the_indentation_and_deeper_is_negative(run):
    assert run.trajectory.normal_errors_mm().mean() == pytest.approx(-1e3 * INDENTATION, abs=0.1)


def test_the_error_across_the_normal_holds_no_indentation(run):
    tangential_mm = run.trajectory.tangential_errors_mm()
    assert 0 < tangential_mm.max() <= 1e3 * SLIP * np.sqrt(3)


def test_normal_and_tangential_parts_make_up_the_whole_error(run):
    whole = np.linalg.norm(run.trajectory.path_errors_mm(), axis=1)
    parts = np.hypot(run.trajectory.normal_errors_mm(), run.trajectory.tangential_errors_mm())
    np.testing.assert_allclose(parts, whole, rtol=1e-9)


def test_errors_are_taken_over_the_loop_only(run):
    errors_mm = run.trajectory.path_errors_mm()
    assert np.isfinite(errors_mm).all()
    assert len(errors_mm) == run.trajectory.phase.count("loop")


def test_phases_follow_each_other_without_a_gap(run):
    spans = run.trajectory.spans()
    assert [span.phase for span in spans] == ["approach", "settle", "loop", "retreat"]
    assert all(before.end == after.start for before, after in pairwise(spans))
    loop = spans[2]
    assert loop.end - loop.start == pytest.approx(16.0, abs=2 * PERIOD)


def test_a_pressing_probe_has_a_positive_force(run):
    assert np.median(run.trajectory.pressing_force[run.trajectory.in_loop]) == pytest.approx(
        5.0, abs=0.1
    )


def test_time_counts_from_the_beginning_of_the_log():
    log = synthetic_log(np.random.default_rng(0))
    time = replace(log, t=log.t + 86400.0).elapsed
    assert time[0] == 0.0
    assert time[1] == pytest.approx(PERIOD, abs=1e-9)


def test_a_log_from_hardware_has_no_truth(tmp_path):
    trajectory = Trajectory.load(write_run(tmp_path, with_truth=False) / "trajectory.parquet")
    assert trajectory.true_force is None
    assert trajectory.true_depth is None
    assert trajectory.true_tilt is None


@pytest.mark.parametrize("with_truth", [True, False])
def test_a_log_is_read_back_as_it_was_saved(tmp_path, with_truth):
    """Poses to the last digits: their rotations are saved as quaternions."""
    log = synthetic_log(np.random.default_rng(0), with_truth=with_truth)
    log.save(tmp_path / "log.parquet")
    for name, values in vars(Trajectory.load(tmp_path / "log.parquet")).items():
        if name.startswith("X_"):
            np.testing.assert_allclose(values, getattr(log, name), rtol=0, atol=1e-12)
        else:
            np.testing.assert_array_equal(values, getattr(log, name))


def test_a_folder_without_a_log_is_no_run(tmp_path):
    with pytest.raises(ConfigError, match="breastscan scan --out"):
        Trajectory.load(tmp_path / "trajectory.parquet")


def test_a_loop_between_its_samples_is_linear_and_at_them_itself(run):
    loop = run.trajectory.take(np.flatnonzero(run.trajectory.in_loop))
    np.testing.assert_allclose(loop.between(loop.s).X_BP, loop.X_BP, atol=1e-12)
    half_way = (loop.s[:-1] + loop.s[1:]) / 2
    between = loop.between(half_way)
    np.testing.assert_allclose(between.q, (loop.q[:-1] + loop.q[1:]) / 2, atol=1e-12)
    np.testing.assert_allclose(between.s, half_way)
    assert set(between.phase) == {"loop"}
