"""Versions of what the numbers of a run depend on."""

import platform
from importlib.metadata import PackageNotFoundError, version

REPORTED = (
    "breastscan", "mujoco", "dm-control", "numpy", "scipy", "opencv-python-headless", "numba",
)  # fmt: skip


def version_of(package: str) -> str:
    """A package's version; "not installed" of a tree that is run as it lies."""
    try:
        return version(package)
    except PackageNotFoundError:  # no reason to lose a scan
        return "not installed"


def versions() -> dict[str, str]:
    """Python's version, and those of `REPORTED`."""
    return {"python": platform.python_version(), **{name: version_of(name) for name in REPORTED}}
