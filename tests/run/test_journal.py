"""A log on disk while it grows."""

import os
import signal
import subprocess
import sys

import numpy as np

from breastscan.control.phases import Phase
from breastscan.run import journal
from breastscan.run.trajectory import Sample
from tests.sim.controller.served import ROOT


def sample(k):
    arrays = np.random.default_rng(k).normal(size=(4, 6))
    phase = list(Phase)[k % len(Phase)]
    return Sample(0.002 * k, phase, np.nan if k % 3 else k + 0.25, *arrays, bool(k % 2))


def same(found, expected):
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_what_comes_into_the_log_is_read_back_to_the_last_digit(tmp_path):
    path, log = tmp_path / "journal.bin", []
    with journal.written(path, log):
        log.extend(map(sample, range(40)))
    same(journal.read(path), log)
    with journal.written(path, log):
        log.extend(map(sample, range(40, 50)))
    same(journal.read(path), log)


def test_a_record_that_was_cut_off_is_left_out_and_written_over(tmp_path):
    path, log = tmp_path / "journal.bin", []
    with journal.written(path, log):
        log.extend(map(sample, range(5)))
    path.write_bytes(path.read_bytes()[:-7])
    log = journal.read(path)
    same(log, [sample(k) for k in range(4)])
    with journal.written(path, log):
        log.append(sample(9))
    same(journal.read(path), [*map(sample, range(4)), sample(9)])


def test_every_phase_has_room_in_a_record():
    assert max(len(phase) for phase in Phase) <= journal.RECORD["phase"].itemsize
    assert journal._PACKED.size == journal.RECORD.itemsize


def test_a_killed_program_leaves_what_was_there_before(tmp_path):
    path = tmp_path / "journal.bin"
    program = (
        "import sys, pathlib; from breastscan.run import journal\n"
        "from tests.run.test_journal import sample\n"
        "log = []\n"
        "with journal.written(pathlib.Path(sys.argv[1]), log):\n"
        "    log.extend(map(sample, range(20)))\n"
        "    sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", program, str(path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    child = subprocess.Popen(command, cwd=ROOT, env=environment, stdin=subprocess.PIPE)
    while not path.exists() or path.stat().st_size < 20 * journal.RECORD.itemsize:
        assert child.poll() is None
    child.send_signal(signal.SIGKILL)
    child.communicate()
    same(journal.read(path), [sample(k) for k in range(20)])
