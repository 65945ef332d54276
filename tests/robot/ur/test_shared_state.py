"""A state that is written while it is read comes out whole."""

import multiprocessing
import threading

import numpy as np

from breastscan.robot.ur.faults import Fault
from breastscan.robot.ur.shared_state import ControllerState, SharedState


def state(k):
    six = np.full(6, float(k))
    return ControllerState(float(k), six, six, six, k, k, Fault(k % len(Fault)), float(k), float(k))


def test_what_was_written_is_read():
    shared = SharedState(multiprocessing.get_context("spawn"))
    shared.write(state(7))
    read = shared.read()
    assert (read.time, read.sample, read.acknowledged, read.fault) == (7.0, 7, 7, Fault(7))
    np.testing.assert_array_equal(read.q, np.full(6, 7.0))


def test_a_reader_never_sees_two_states_mixed():
    shared = SharedState(multiprocessing.get_context("spawn"))
    done = threading.Event()

    def write():
        for k in range(2000):
            shared.write(state(k))
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    while not done.is_set():
        read = shared.read()
        values = {
            read.time,
            *read.q,
            *read.qd,
            *read.force_B,
            float(read.sample),
            float(read.acknowledged),
            read.seen,
        }
        assert len(values) == 1
    writer.join()
