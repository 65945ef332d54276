"""What the commands share: the terminal, options that mean the same everywhere, and the telling
of MuJoCo's errors.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import walk_tb
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from breastscan.errors import ConfigError

console = Console()

Out = Annotated[
    Path,
    tyro.conf.arg(
        metavar="DIR", help="Folder for the results; earlier ones stay until these are complete."
    ),
]
Seed = Annotated[int, tyro.conf.arg(metavar="N", help="Seed of everything random.")]

GL_PACKAGES = "libegl1 libgles2 libgl1 libgl1-mesa-dri"
"""Debian's and Ubuntu's packages for headless OpenGL."""


@contextmanager
def twin_imports() -> Iterator[None]:
    """Import what may import MuJoCo, which loads its OpenGL back end at once and fails there in its
    own ways.

    Raises:
        ConfigError: The back end that MUJOCO_GL names cannot be loaded.
    """
    try:
        yield
    except (AttributeError, ImportError, OSError, RuntimeError) as error:
        modules = [frame.f_globals.get("__name__", "") for frame, _ in walk_tb(error.__traceback__)]
        if not any(module.startswith(("mujoco", "dm_control")) for module in modules):
            raise  # some other import, which no back end mends
        raise ConfigError(
            f"MuJoCo does not load with MUJOCO_GL={os.environ.get('MUJOCO_GL', '(unset)')} "
            f"({error}): set it to egl; where that fails as well, on Debian or Ubuntu: apt-get "
            f"install {GL_PACKAGES}",
            error,
        ) from error


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """A listener for `Stages` that shows one line of progress for each stage."""
    progress = Progress(
        TextColumn("{task.description:<14}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), console=console,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def listen(stage: str, fraction: float) -> None:
        if stage not in tasks:
            tasks[stage] = progress.add_task(stage, total=1.0)
        progress.update(tasks[stage], completed=fraction)

    with progress:
        yield listen
