"""Shapes are checked in every test: jaxtyping's import hook with beartype, at no cost at run time.

Modules without arrays in their types have no shapes to check; wrapping them would only slow the
control loop down.
"""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).parent.parent
SOURCES = [
    path
    for package in ("breastscan", "sim", "experiments")
    for path in (ROOT / package).rglob("*.py")
]
SHAPED = [path for path in SOURCES if "from jaxtyping import" in path.read_text(encoding="utf-8")]

install_import_hook(
    [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in SHAPED], "beartype.beartype"
)

# The same examples in every run, and no deadline: the first example may compile a kernel.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

MAX_LATENESS = 0.002
"""By which a period may begin late where 500 Hz are held [s]: one period."""
PROCESSES = 3
"""That take part in a scan over the link: the twin, who talks to it, and who decides."""
PACE = """
import time
due, late = time.monotonic(), 0.0
for _ in range(500):
    due += 0.002
    while time.monotonic() < due - 0.0013:  # a third of the period is work
        pass
    time.sleep(max(due - time.monotonic(), 0.0))
    late = max(late, time.monotonic() - due)
print(late)
"""


def pytest_runtest_setup(item):
    """Tests marked `realtime` are left out where 500 Hz are not held anyway."""
    if item.get_closest_marker("realtime") is not None and lateness() > MAX_LATENESS:
        pytest.skip(
            f"in a second of 500 Hz a period began {lateness() * 1e3:.0f} ms late, at most "
            f"{MAX_LATENESS * 1e3:.0f} ms are held here: the machine is busy"
        )


@cache
def lateness() -> float:
    """The latest period of a second of 500 Hz in as many processes as the link takes [s]."""
    command = [sys.executable, "-c", PACE]
    paced = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(PROCESSES)]
    return max(float(process.communicate()[0]) for process in paced)


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    """One synthetic run, written once for all tests that only read it."""
    from tests.run.synthetic_run import write_run  # after the import hook is there

    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def run(run_folder):
    from breastscan.run.reading import Run

    return Run.load(run_folder)
