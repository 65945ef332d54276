"""The progress bars tell why a stage takes long the first time, and how long it will still take."""

import io

import numba
import pytest
from rich.console import Console

from breastscan.commands import console


@pytest.fixture
def screen(monkeypatch):
    screen = Console(file=io.StringIO(), force_terminal=True, width=140)
    monkeypatch.setattr(console, "console", screen)
    return screen.file


def test_a_stage_says_that_it_compiles_while_it_does(screen):
    kernel = numba.njit(lambda x: x + 1)
    with console.progress_bars() as listen:
        listen("stereo", 0.0)
        seen = screen.tell()
        kernel(1)
        listen("stereo", 1.0)
    screen.seek(seen)
    assert console.COMPILING in screen.read()


def test_a_stage_that_finds_its_kernels_compiled_says_nothing(screen):
    kernel = numba.njit(lambda x: x + 2)
    kernel(1)
    with console.progress_bars() as listen:
        listen("stereo", 0.0)
        kernel(1)
        listen("stereo", 1.0)
    assert console.COMPILING not in screen.getvalue()


def test_a_stage_that_is_done_no_longer_compiles(screen):
    kernel = numba.njit(lambda x: x + 3)
    with console.progress_bars() as listen:
        listen("stereo", 0.0)
        kernel(1)
        listen("stereo", 1.0)
        seen = screen.tell()
    screen.seek(seen)
    assert console.COMPILING not in screen.read()


@pytest.mark.parametrize(
    ("completed", "remaining", "shown"),
    [(0.0, 12.0, ""), (0.4, 12.7, "0:00:12 left"), (1.0, 0.0, ""), (0.4, None, "")],
)
def test_the_time_left_is_shown_of_a_stage_that_tells_how_far_it_is(completed, remaining, shown):
    class Task:
        finished = completed == 1.0
        time_remaining = remaining

    Task.completed = completed
    assert console.TimeLeft().render(Task()).plain == shown
