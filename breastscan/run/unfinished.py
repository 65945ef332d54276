"""Where in a run folder that lies which a scan leaves until it is complete, and with which another
one goes on.
"""

from pathlib import Path

from breastscan.errors import ConfigError

ABORTED = "aborted"
"""The folder, gone when the scan is complete."""
SETTINGS_FILE = "config.json"
"""What the scan is made with; the last to be written before the arm moves."""
CELL_FILE = "cell.json"
PLAN_FILE = "plan.npz"
"""Joint angles of the plan, and where the arm stood before."""
JOURNAL_FILE = "journal.bin"
"""The log as it grows (`run.journal`)."""
TRUTH_FILE = "truth.npz"
"""What only a simulation knows."""


def settings_file(out: Path) -> Path:
    """The settings of a scan into `out` that was cut off.

    Raises:
        ConfigError: There is none, or none that can go on.
    """
    path = out / ABORTED / SETTINGS_FILE
    if path.is_file():
        return path
    if path.parent.is_dir():
        why = f"what {path.parent} holds is of a version that left no settings there: scan again"
    elif (out / "metrics.json").is_file():
        why = f"the scan in {out} is complete"
    else:
        why = f"in {out} no scan was cut off with the arm on its way"
    raise ConfigError(f"nothing to resume: {why}", out)
