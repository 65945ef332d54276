"""A twin behind a controller's ports in a process of its own, and clients of it in others."""

import os
import socket
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[3]


def address(net):
    """Loopback address of this process's own, in one of 256 nets: a controller's ports are fixed,
    and tests may run twice at a time.
    """
    return f"127.{net}.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"


@contextmanager
def served(host, *options, clock="lockstep", module=("breastscan",)):
    """Run `breastscan twin` at a loopback address; yields its process.

    `module` is what is run in place of `breastscan`, with arguments that come first.
    """
    options = ("--controller.host", host, "--clock", clock, *options)
    command = [sys.executable, "-m", *module, "twin", *options]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        for line in process.stdout:
            if line.startswith("Ready"):
                break
        else:
            raise AssertionError(f"the twin ended with {process.wait()}")
        yield process
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
        process.stdout.close()


def pass_time(twin, seconds):
    """Wait so long on the twin's clock [s]."""
    until = twin.do("status")["time"] + seconds
    while twin.do("status")["time"] < until:
        time.sleep(0.005)


def ask_dashboard(host, *lines):
    """Send lines to a controller's dashboard, one after the other."""
    with (
        socket.create_connection((host, 29999), 5) as connection,
        connection.makefile("rw") as stream,
    ):
        stream.readline()
        for line in lines:
            stream.write(line + "\n")
            stream.flush()
            stream.readline()


def client(program, *arguments, timeout=120):
    """Run a program in a process of its own, since the client library can take one down; what it
    printed.
    """
    finished = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), *arguments],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout
