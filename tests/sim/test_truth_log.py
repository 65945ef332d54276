"""The truth of a robot as a file."""

import numpy as np

from breastscan.run import parquet
from breastscan.run.columns import TRUTH
from sim.truth_log import TruthRecorder


def test_the_truth_is_read_back_as_it_was_saved(tmp_path):
    recorder, X_SP = TruthRecorder(), np.diag([1.0, -1.0, -1.0, 1.0])
    for row in range(3):
        recorder.add(
            0.002 * row, np.full(6, float(row)), np.array([0.0, 0.1, row]), 1e-3 * row, X_SP
        )
    log = recorder.log()
    log.save(tmp_path / "truth.parquet")
    for name, values in parquet.read(tmp_path / "truth.parquet", TRUTH).items():
        np.testing.assert_allclose(values, getattr(log, name), rtol=0, atol=1e-12)
