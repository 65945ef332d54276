"""Shapes are checked in every test: jaxtyping's import hook with beartype, at no cost at run time.

Modules without arrays in their types have no shapes to check; wrapping them would only slow the
control loop down.
"""

import os
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import jaxtyping
import pytest
from hypothesis import settings

ROOT = Path(__file__).parent.parent
SOURCES = [
    path
    for package in ("breastscan", "sim", "experiments")
    for path in (ROOT / package).rglob("*.py")
]
SHAPED = [path for path in SOURCES if "from jaxtyping import" in path.read_text(encoding="utf-8")]

jaxtyping.install_import_hook(
    [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in SHAPED], "beartype.beartype"
)

# The same examples in every run, and no deadline: the first example may compile a kernel.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

MAX_LATENESS = 0.002
"""By which a period may begin late where 500 Hz are held [s]: one period."""
MAX_LATE_RATE = 10.0
"""Such periods a second beside a test; on a quiet machine there is about one [1/s]."""
MAX_STALL = 0.02
"""By which a single one may: what the link bears, for all of its processes together [s]."""
PROCESSES = 3
"""That take part in a scan over the link: the twin, who talks to it, and who decides."""
PACE = """
import select, sys, time
work, max_lateness = map(float, sys.argv[1:])
begun = due = time.monotonic()
late, latest = 0, 0.0
while not select.select([sys.stdin], [], [], 0)[0]:
    due += 0.002
    while time.monotonic() < due - 0.002 + work:
        pass
    time.sleep(max(due - time.monotonic(), 0.0))
    lateness = time.monotonic() - due
    late, latest = late + (lateness > max_lateness), max(latest, lateness)
print(late, latest, time.monotonic() - begun)
"""
WITNESS = pytest.StashKey[subprocess.Popen]()


def pytest_runtest_setup(item):
    """Tests marked `realtime` are left out where 500 Hz are not held anyway; and shapes, half a
    period's work, are not checked in them.
    """
    if item.get_closest_marker("realtime") is None:
        return
    if lateness() > MAX_LATENESS:
        pytest.skip(
            f"in a second of 500 Hz a period began {lateness() * 1e3:.0f} ms late, at most "
            f"{MAX_LATENESS * 1e3:.0f} ms are held here: the machine is busy"
        )
    jaxtyping.config.update("jaxtyping_disable", True)
    item.stash[WITNESS] = paced(work=0.0)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """One that fails counts as left out where 500 Hz were not held beside it either."""
    report = yield
    if WITNESS in item.stash and (report.when == "call" or report.failed):
        late, latest, seconds = ended(item.stash[WITNESS])
        del item.stash[WITNESS]
        jaxtyping.config.update("jaxtyping_disable", False)
        seen = (
            f"{late:.0f} periods of 500 Hz began more than {MAX_LATENESS * 1e3:.0f} ms late beside "
            f"it in {seconds:.1f} s, one of them {latest * 1e3:.0f} ms"
        )
        report.sections.append(("The machine", seen))
        if report.failed and (late > MAX_LATE_RATE * max(seconds, 1.0) or latest > MAX_STALL):
            reason = f"Skipped: it failed while {seen}: the machine is busy"
            report.outcome, report.longrepr = "skipped", (*item.location[:2], reason)
    return report


@cache
def lateness() -> float:
    """The latest period of a second of 500 Hz in as many processes as the link takes [s]."""
    processes = [paced(work=0.0007) for _ in range(PROCESSES)]
    time.sleep(1.0)
    return max(ended(process)[1] for process in processes)


def paced(work: float) -> subprocess.Popen:
    """A process of 500 Hz, busy for so much of each period [s]."""
    command = [sys.executable, "-c", PACE, str(work), str(MAX_LATENESS)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def ended(process: subprocess.Popen) -> tuple[float, float, float]:
    """Late periods of one that is ended here, the latest [s], and how long it went [s]."""
    late, latest, seconds = map(float, process.communicate()[0].split())
    return late, latest, seconds


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    """One synthetic run, written once for all tests that only read it."""
    from tests.run.synthetic_run import write_run  # after the import hook is there

    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def run(run_folder):
    from breastscan.run.reading import Run

    return Run.load(run_folder)
