"""Every way in which a controller can stop is told by name, with a cure."""

import pytest

from breastscan.errors import RobotError
from breastscan.robot.ur import faults
from breastscan.robot.ur.faults import Fault

PLAYING = 2
STOPPED = 1
PAUSED = 4
NORMAL = 0b1


@pytest.mark.parametrize(
    ("safety_bits", "runtime_state", "fault"),
    [
        (NORMAL, PLAYING, Fault.NONE),
        (NORMAL, STOPPED, Fault.PROGRAM),
        (0x404, PAUSED, Fault.PROTECTIVE_STOP),
        (0x4C0, STOPPED, Fault.EMERGENCY_STOP),
        (0x4C4, STOPPED, Fault.EMERGENCY_STOP),
        (1 << 4, PAUSED, Fault.SAFEGUARD_STOP),
        (1 << 8, STOPPED, Fault.SAFETY_FAULT),
    ],
)
def test_the_gravest_of_what_the_controller_says_is_the_fault(safety_bits, runtime_state, fault):
    assert faults.diagnose(safety_bits, runtime_state) is fault


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault is not Fault.NONE])
def test_every_fault_has_words_and_a_cure(fault):
    error = faults.error(fault)
    assert isinstance(error, RobotError)
    assert error.value is fault
    what, cure = faults.WORDS[fault]
    assert what in str(error)
    assert cure in str(error)
