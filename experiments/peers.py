"""Packages that the benchmark compares with where they are installed: none is needed to run."""

import importlib
import importlib.util
from typing import Any


def peer(name: str) -> Any | None:
    """The package, or None with a printed line where it is missing."""
    if importlib.util.find_spec(name) is None:
        print(f"no rows against {name}, which is not installed: pip install 'breastscan[bench]'")
        return None
    return importlib.import_module(name)
