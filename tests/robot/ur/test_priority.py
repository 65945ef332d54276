"""The supervisor's priority while the arm is driven."""

import os
import threading

import pytest

from breastscan.robot.ur.priority import ask_for_priority, priority


def _granted():
    granted = []
    thread = threading.Thread(target=lambda: granted.append(ask_for_priority()))
    thread.start()
    thread.join()
    return granted[0]


def test_the_thread_that_drives_has_priority_and_gives_it_back():
    if not _granted():
        pytest.skip("the system grants no real-time priority here")
    before = os.sched_getscheduler(0)
    with pytest.raises(ValueError, match="ended"), priority():
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
        raise ValueError("ended")
    assert os.sched_getscheduler(0) == before
