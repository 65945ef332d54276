"""Where the numbers of a run come from: when, by which command, from which commit, with which
versions.
"""

import platform
import shlex
import subprocess
import sys
from datetime import datetime
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

REPORTED = (
    "breastscan", "mujoco", "dm-control", "numpy", "scipy", "opencv-python-headless", "numba",
)  # fmt: skip
TREE = Path(__file__).parents[2]
"""The folder that holds the package: a checkout, or site-packages."""
PROGRAM = "breastscan"
NOT_INSTALLED = "not installed"
GIT_TIME = 10.0
"""Longest wait for git [s]: on a network drive it may hang."""


def provenance() -> dict[str, Any]:
    """Date (ISO, with its offset from UTC), command, commit (None where git knows none) and
    versions.
    """
    return {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "command": command(sys.argv),
        "commit": commit(TREE),
        "versions": versions(),
    }


def command(argv: list[str]) -> str:
    """What the user typed, quoted for a shell; a script by its path."""
    script, *rest = argv or [""]
    path = Path(script)
    is_ours = path.stem == PROGRAM or (path.parent.name, path.name) == (PROGRAM, "__main__.py")
    return shlex.join([PROGRAM if is_ours else script, *rest])


def commit(tree: Path) -> str | None:
    """The commit that lies in `tree`, "-dirty" behind it where files were changed since; None
    without git, or where `tree` is no checkout: a repository around it is another's.
    """
    if not (tree / ".git").exists():
        return None
    git = ["git", "--no-optional-locks", f"--git-dir={tree / '.git'}", f"--work-tree={tree}"]
    asked = ["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        answer = subprocess.run(
            [*git, *asked], capture_output=True, text=True, check=True, timeout=GIT_TIME
        )
    except (OSError, subprocess.SubprocessError):  # no reason to lose a scan
        return None
    return answer.stdout.strip() or None


def version_of(package: str) -> str:
    """A package's version; "not installed" of a tree that is run as it lies."""
    try:
        return version(package)
    except PackageNotFoundError:  # no reason to lose a scan
        return NOT_INSTALLED


def versions() -> dict[str, str]:
    """Python's version, and those of `REPORTED`."""
    return {"python": platform.python_version(), **{name: version_of(name) for name in REPORTED}}


def unsuited() -> list[str]:
    """What is installed in a version that this package was not made for, or not at all, a line
    each.
    """
    try:
        needed = [Requirement(line) for line in requires(PROGRAM) or ()]
    except PackageNotFoundError:  # a tree that is run as it lies says nothing of its needs
        return []
    found = []
    for need in needed:
        if need.marker is None or need.marker.evaluate():
            there = version_of(need.name)
            if there == NOT_INSTALLED or not need.specifier.contains(there, prereleases=True):
                found.append(f"{need.name} is {there}, needed is {need.specifier}")
    return found
