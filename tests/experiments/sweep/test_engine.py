"""Each run once, whoever is killed: told by lines that the runs themselves write."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from breastscan.errors import ConfigError
from experiments.sweep.engine import MAX_DEATHS, RECORDS, carry_out, here
from tests.experiments.sweep.stubs import deadly, full, noted, squared, stubs

ROOT = Path(__file__).parents[3]
RUNS = 24
DRIVER = """
import sys
from pathlib import Path
from experiments.sweep.engine import carry_out, here
from tests.experiments.sweep.stubs import squared, stubs

folder = Path(sys.argv[1])
carry_out(squared, stubs(24, folder, seconds=0.3), folder, here(2))
"""


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def records(folder):
    return {
        int(path.stem): json.loads(path.read_text()) for path in (folder / RECORDS).glob("*.json")
    }


def squares(count):
    return {number: {"square": number**2} for number in range(count)}


def wait_for(condition, seconds=60):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.fixture
def driver(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", DRIVER, str(tmp_path)], cwd=ROOT)
    yield process
    process.kill()
    process.wait()


def test_all_run_once_and_none_of_them_again(tmp_path):
    told = []
    for _ in range(2):
        carry_out(squared, stubs(RUNS, tmp_path), tmp_path, here(2), told.append)
    assert records(tmp_path) == squares(RUNS)
    assert sorted(number for number, _ in noted(tmp_path, "ends")) == list(range(RUNS))
    assert told[: RUNS + 1] == list(range(RUNS + 1))
    assert told[-1] == RUNS
    assert len({pid for _, pid in noted(tmp_path, "ends")}) == 2


def test_a_killed_worker_costs_only_what_it_was_at(tmp_path, driver):
    wait_for(lambda: len(noted(tmp_path, "ends")) > 4)
    number, pid = noted(tmp_path, "begins")[-1]
    os.kill(pid, signal.SIGKILL)
    assert driver.wait(60) == 0
    assert records(tmp_path) == squares(RUNS)
    ended = sorted(one for one, _ in noted(tmp_path, "ends"))
    assert ended == list(range(RUNS))
    assert number in ended


def test_after_a_killed_driver_the_same_sweep_does_the_rest_and_no_run_twice(tmp_path, driver):
    wait_for(lambda: len(noted(tmp_path, "ends")) > 4)
    driver.kill()
    driver.wait()
    workers = {pid for _, pid in noted(tmp_path, "begins")}
    carry_out(squared, stubs(RUNS, tmp_path), tmp_path, here(2))  # its workers are still at theirs
    assert records(tmp_path) == squares(RUNS)
    assert sorted(number for number, _ in noted(tmp_path, "ends")) == list(range(RUNS))
    wait_for(lambda: not any(map(is_running, workers)))


def test_ctrl_c_as_often_as_one_likes_makes_no_run_a_failed_one(tmp_path):
    for _ in range(MAX_DEATHS + 1):
        process = subprocess.Popen(
            [sys.executable, "-c", DRIVER, str(tmp_path)], cwd=ROOT, start_new_session=True
        )
        begun = len(noted(tmp_path, "begins"))
        wait_for(lambda begun=begun: len(noted(tmp_path, "begins")) > begun)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(60) != 0
    carry_out(squared, stubs(RUNS, tmp_path, seconds=0.0), tmp_path, here(2))
    assert records(tmp_path) == squares(RUNS)


def test_a_run_that_takes_its_process_along_counts_as_failed_and_stops_no_other(tmp_path):
    carry_out(deadly, stubs(RUNS, tmp_path), tmp_path, here(2))
    found = records(tmp_path)
    assert found.pop(3)["error"].startswith(
        f"WorkerDied: its process was killed {MAX_DEATHS} times"
    )
    assert found == {number: one for number, one in squares(RUNS).items() if number != 3}


def test_two_at_once_in_one_folder_are_refused(tmp_path, driver):
    wait_for(lambda: noted(tmp_path, "begins"))
    with pytest.raises(ConfigError, match="another process fills"):
        carry_out(squared, stubs(RUNS, tmp_path), tmp_path, here(2))


def test_a_full_disk_is_told_as_one(tmp_path):
    with pytest.raises(OSError, match="No space left"):
        carry_out(full, stubs(2, tmp_path), tmp_path, here(1))
