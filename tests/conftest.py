"""Shapes are checked in every test: jaxtyping's import hook with beartype, at no cost at run time."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from jaxtyping import install_import_hook

install_import_hook(["breastscan", "sim", "experiments"], "beartype.beartype")
