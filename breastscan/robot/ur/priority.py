"""Real-time priority for what must be there every 2 ms, where the system grants it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 20
"""Of the first-in, first-out class: before every program of the usual one."""


def ask_for_priority() -> bool:
    """Real-time scheduling for this thread and those it starts; whether the system grants it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        return False
    return True


@contextmanager
def priority() -> Iterator[None]:
    """Real-time scheduling for this thread inside the block."""
    granted = ask_for_priority()
    try:
        yield
    finally:
        if granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
