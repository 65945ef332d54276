"""What does the link cost? The twin behind its ports, driven by the robot class that drives the
real arm.

`python -m experiments.bench_rtde` streams 10 000 targets, once at normal and once at real-time
priority, with a second client listening, and runs the whole scan in process and over the sockets.
Give the machine nothing else to do.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import polars as pl
from rich.console import Console
from rich.table import Table

from breastscan.errors import RobotError
from breastscan.robot.ur.rtde_robot import RtdeConfig, RtdeRobot
from breastscan.run.metrics import rms
from sim.controller.fault_injection import TwinControl
from sim.error_analysis import STEADY_AFTER
from sim.scene import Scene
from sim.wrist.probe import payload

HOST = "127.0.0.5"
CYCLES = 10_000
SWING, SWING_RATE = 0.05, 2.0
"""Motion of the last joint while targets are streamed [rad], [rad/s]."""
LISTENING = 8.0
"""For how long a second client counts [s]."""
LISTENER = """
import sys, time
from rtde_receive import RTDEReceiveInterface
frequency = float(sys.argv[2])
receive = RTDEReceiveInterface(sys.argv[1], frequency)
before, count, start = receive.getTimestamp(), 0, time.monotonic()
first = before
while time.monotonic() - start < float(sys.argv[3]):
    now = receive.getTimestamp()
    count += now != before
    before = now
    time.sleep(0.0002)
print(count / (before - first))
"""
"""Counts the states that come in a second of the controller's clock."""
FORCE = 5.0
"""Set-point [N]."""


def main() -> None:
    """Measure and print."""
    console = Console()
    table = Table(title="The link", title_justify="left")
    for heading in ("what", "measured"):
        table.add_column(heading)
    for name, real_time in (("normal priority", False), ("real-time priority", True)):
        for what, value in stream(real_time).items():
            table.add_row(f"{what}, {name}", value)
    for what, value in whole_scan().items():
        table.add_row(what, value)
    console.print(table)


@contextmanager
def twin(*options: str) -> Iterator[None]:
    """`breastscan twin` in a process of its own."""
    command = [sys.executable, "-m", "breastscan", "twin", "--controller.host", HOST, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None, "it was asked for"
        try:
            for line in process.stdout:
                if line.startswith("Ready"):
                    break
            yield
        finally:
            process.terminate()


def stream(real_time: bool) -> dict[str, str]:
    """Targets in every period, and what became of them."""
    priority = () if real_time else ("--controller.no-real-time",)
    scene = Scene()
    config = RtdeConfig(
        host=HOST, X_FP=scene.X_FP, payload=payload(scene.config.mount_angle), real_time=real_time
    )
    with (
        twin(*priority),
        closing(RtdeRobot(config)) as robot,
        closing(TwinControl(HOST)) as control,
    ):
        listeners = [
            subprocess.Popen(
                [sys.executable, "-c", LISTENER, HOST, str(rate), str(LISTENING)],
                stdout=subprocess.PIPE,
                text=True,
            )
            for rate in (125, 500)
        ]
        q = robot.state().q
        refused, lag = 0, []
        control.do("reset")
        before, start = control.do("status"), time.monotonic()
        for k in range(CYCLES):
            target = q.copy()
            target[5] += SWING * np.sin(SWING_RATE * k * robot.period)
            try:
                robot.servo_joint(target)
            except RobotError as error:
                refused += 1
                lag.append(str(error))
                break
        after, wall = control.do("status"), time.monotonic() - start
        rates = [float(listener.communicate()[0]) for listener in listeners]
    none, one, more = after["cycles"]
    spent = after["cpu_s"] - before["cpu_s"]
    return {
        "targets refused or lost": f"{refused} of {CYCLES}" + "".join(f" ({why})" for why in lag),
        "cycles with no / one / more packages [%]": " / ".join(
            f"{100 * count / (none + one + more):.2f}" for count in (none, one, more)
        ),
        "a second client's states a second, at 125 and 500 Hz": " / ".join(
            f"{rate:.1f}" for rate in rates
        ),
        "twin's fraction of a core, three clients [%]": f"{100 * spent / wall:.0f}",
    }


def whole_scan() -> dict[str, str]:
    """The scan in process and over the link: how it tracked, and the force that was true."""
    with tempfile.TemporaryDirectory() as folder:
        near = Path(folder) / "near"
        far = Path(folder) / "far"
        truth = Path(folder) / "truth"
        _breastscan("scan", "--no-video", "--out", str(near))
        with twin("--out", str(truth)):
            _breastscan(
                "scan", "--no-video", "--robot", f"rtde://{HOST}", "--yes", "--out", str(far)
            )
        deadline = time.monotonic() + 20
        while not (truth / "truth.parquet").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        in_process = _figures(near, near / "trajectory.parquet")
        over_link = _figures(far, truth / "truth.parquet")
    return {
        f"{name}, in process / over the link": f"{in_process[name]:.3f} / {over_link[name]:.3f}"
        for name in in_process
    }


def _figures(run: Path, truth: Path) -> dict[str, float]:
    """Of one run folder, and what really happened."""
    measured = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    loop = (
        pl.read_parquet(run / "trajectory.parquet")
        .filter(pl.col("phase") == "loop")["t_s"]
        .to_numpy()
    )
    true = pl.read_parquet(truth)
    t = true["t_s"].to_numpy()
    steady = (t >= loop[0] + STEADY_AFTER) & (t <= loop[-1])
    return {
        "tracking across the normal, RMS [mm]": measured["tracking_tangential_rmse_mm"],
        "true force about 5 N, RMS [N]": rms(true["true_force_n"].to_numpy()[steady] - FORCE),
    }


def _breastscan(*arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "breastscan", *arguments], check=True, stdout=subprocess.DEVNULL
    )


if __name__ == "__main__":
    os.environ.setdefault("MUJOCO_GL", "egl")
    main()
