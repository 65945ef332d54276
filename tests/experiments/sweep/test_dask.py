"""The same runs on a scheduler and two workers of dask.distributed, on loopback."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from breastscan.errors import ConfigError
from experiments.sweep.engine import carry_out, dask
from tests.experiments.sweep.stubs import noted, squared, stubs
from tests.experiments.sweep.test_engine import ROOT, records, squares, wait_for

RUNS = 16


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Cluster:
    def __init__(self, threads=1):
        self.address = f"127.0.0.1:{free_port()}"
        host, port = self.address.split(":")
        self.scheduler = self._start(
            "scheduler", "--host", host, "--port", port, "--no-dashboard", "--no-show"
        )
        _wait_for_port(int(port))
        self.workers = [
            self._start(
                "worker", self.address, "--host", host, "--nthreads", str(threads), "--no-nanny",
                "--no-dashboard", "--death-timeout", "30",
            )
            for _ in range(2)
        ]  # fmt: skip

    @staticmethod
    def _start(*arguments):
        command = [sys.executable, "-m", "dask", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            command, cwd=ROOT, env=environment,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def end(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


def _wait_for_port(port):
    for _ in range(600):
        with socket.socket() as client:
            if client.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise AssertionError("the scheduler does not start")


def ready(cluster, folder):
    """An engine, once both workers are there."""
    import distributed

    with distributed.Client(cluster.address, timeout=30, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    return dask(cluster.address, folder)


@pytest.fixture
def cluster():
    cluster = Cluster()
    yield cluster
    cluster.end()


def test_records_are_those_of_this_machine_also_when_a_worker_is_killed(tmp_path, cluster):
    engine = ready(cluster, tmp_path)
    doomed = cluster.workers[0].pid

    def kill_one(done):
        if done == 4:
            os.kill(doomed, signal.SIGKILL)

    carry_out(squared, stubs(RUNS, tmp_path, seconds=0.2), tmp_path, engine, kill_one)
    assert records(tmp_path) == squares(RUNS)
    assert sorted(number for number, _ in noted(tmp_path, "ends")) == list(range(RUNS))
    assert len({pid for _, pid in noted(tmp_path, "begins")}) == 2


def test_when_the_scheduler_is_killed_what_is_finished_is_kept_and_the_rest_done_elsewhere(
    tmp_path, cluster
):
    engine = ready(cluster, tmp_path)

    def kill_it(done):
        if done == 4:
            cluster.scheduler.kill()

    with pytest.raises(ConfigError, match="the engine is gone"):
        carry_out(squared, stubs(RUNS, tmp_path, seconds=0.2), tmp_path, engine, kill_it)
    assert len(records(tmp_path)) >= 4
    other = Cluster()
    try:
        carry_out(squared, stubs(RUNS, tmp_path), tmp_path, ready(other, tmp_path))
    finally:
        other.end()
    assert records(tmp_path) == squares(RUNS)
    assert sorted(number for number, _ in noted(tmp_path, "ends")) == list(range(RUNS))


def test_workers_that_do_not_fit_are_refused(tmp_path):
    cluster = Cluster(threads=2)
    try:
        engine = ready(cluster, tmp_path)
        with pytest.raises(ConfigError, match="--nthreads 1"):
            carry_out(squared, stubs(2, tmp_path), tmp_path, engine)
    finally:
        cluster.end()
    wait_for(lambda: cluster.scheduler.poll() is not None)


def test_a_scheduler_that_is_not_there_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.sweep.engine.ANSWER_TIME", 1.0)
    with pytest.raises(ConfigError, match="dask scheduler"):
        carry_out(squared, stubs(2, tmp_path), tmp_path, dask(f"127.0.0.1:{free_port()}", tmp_path))
