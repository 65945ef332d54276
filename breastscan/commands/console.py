"""What the commands share: the terminal, options that mean the same everywhere, and the telling
of MuJoCo's errors.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from traceback import walk_tb
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.text import Text

from breastscan.errors import ConfigError

console = Console()

Out = Annotated[
    Path,
    tyro.conf.arg(
        metavar="DIR", help="Folder for the results; earlier ones stay until these are complete."
    ),
]
Seed = Annotated[int, tyro.conf.arg(metavar="N", help="Seed of everything random.")]

COMPILING = "compiling, first run only"
"""Beside a stage that waits for its kernels."""

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


class TimeLeft(ProgressColumn):
    """The time left of a stage that tells how far it is; nothing of any other."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        """The estimate of the last half minute's pace, in whole seconds."""
        if task.finished or not task.completed or task.time_remaining is None:
            return Text("")
        return Text(f"{timedelta(seconds=int(task.time_remaining))} left")


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """A listener for `Stages` that shows one line of progress for each stage: how far it is, how
    long it took, how long it will take, and whether it waits for kernels to be compiled, which they
    are once and then kept.
    """
    progress = Progress(
        TextColumn("{task.description:<14}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(), TimeLeft(), TextColumn("{task.fields[note]}", style="yellow"),
        console=console,
    )  # fmt: skip
    tasks: dict[str, TaskID] = {}

    def listen(stage: str, fraction: float) -> None:
        if stage not in tasks:
            tasks[stage] = progress.add_task(stage, total=1.0, note="")
        progress.update(tasks[stage], completed=fraction)

    def tell(compiling: bool) -> None:
        note = COMPILING if compiling else ""
        for task in progress.tasks:
            progress.update(task.id, note="" if task.finished else note)
        progress.refresh()

    with _compilations(tell), progress:
        yield listen


@contextmanager
def _compilations(tell: Callable[[bool], None]) -> Iterator[None]:
    """Say when numba begins to compile, and when it is done; what it finds in its cache is not
    compiled.
    """
    from numba.core import event

    class Listener(event.Listener):
        depth = 0
        """Kernels that call others wait for them."""

        def on_start(self, event: event.Event) -> None:
            self.depth += 1
            if self.depth == 1:
                tell(True)

        def on_end(self, event: event.Event) -> None:
            self.depth -= 1
            if self.depth == 0:
                tell(False)

    with event.install_listener("numba:compile", Listener()):
        yield
