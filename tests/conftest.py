"""Shapes are checked in every test: jaxtyping's import hook with beartype, at no cost at run time."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from hypothesis import settings
from jaxtyping import install_import_hook

install_import_hook(["breastscan", "sim", "experiments"], "beartype.beartype")

# The same examples in every run, and no deadline: the first example may compile a kernel.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
