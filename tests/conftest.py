"""Shapes are checked in every test: jaxtyping's import hook with beartype, at no cost at run time.

Modules without arrays in their types have no shapes to check; wrapping them would only slow the control loop down.
"""

import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

from hypothesis import settings
from jaxtyping import install_import_hook

ROOT = Path(__file__).parent.parent
SOURCES = [path for package in ("breastscan", "sim", "experiments") for path in (ROOT / package).rglob("*.py")]
SHAPED = [path for path in SOURCES if "from jaxtyping import" in path.read_text(encoding="utf-8")]

install_import_hook([".".join(path.relative_to(ROOT).with_suffix("").parts) for path in SHAPED], "beartype.beartype")

# The same examples in every run, and no deadline: the first example may compile a kernel.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
