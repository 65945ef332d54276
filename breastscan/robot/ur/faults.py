"""What can end a motion on a controller, in words: what happened, and what to do."""

from enum import IntEnum

from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import (
    EMERGENCY_BIT,
    FAULT_BIT,
    PROTECTIVE_BIT,
    ROBOT_EMERGENCY_BIT,
    RUNNING,
    SAFEGUARD_BIT,
    SYSTEM_EMERGENCY_BIT,
    VIOLATION_BIT,
)


class Fault(IntEnum):
    """Why no command is taken."""

    NONE = 0
    LATE = 1
    SILENCE = 2
    PROTECTIVE_STOP = 3
    EMERGENCY_STOP = 4
    SAFEGUARD_STOP = 5
    SAFETY_FAULT = 6
    WATCHDOG = 7
    PROGRAM = 8
    REFUSED = 9
    LOST = 10
    DIED = 11


TRANSIENT = frozenset({Fault.NONE, Fault.LATE, Fault.SILENCE})
"""Transient faults: they end by themselves, or turn out to be another one."""

WORDS = {
    Fault.LATE: (
        "no new target came in time while the arm moved, so it was brought to rest",
        "close other programs, or raise this one's priority; then scan again from where it was",
    ),
    Fault.SILENCE: (
        "silence: the controller sent no new state in time, the arm stops by its watchdog",
        "check the cable, the switch and the pendant, then reconnect",
    ),
    Fault.PROTECTIVE_STOP: (
        "protective stop: the controller saw a collision, a joint beyond its limits, or a wrong "
        "payload",
        "read the reason on the pendant, free the probe, wait 5 s, acknowledge, then reconnect; "
        "never by play, which finishes the interrupted motion",
    ),
    Fault.EMERGENCY_STOP: (
        "emergency stop: a button is pressed",
        "turn it free, close the message on the pendant, power on, release the brakes, free the "
        "probe, then reconnect",
    ),
    Fault.SAFEGUARD_STOP: (
        "safeguard stop: a guard or a three-position switch is open",
        "close it, acknowledge where the cell asks for it, then reconnect",
    ),
    Fault.SAFETY_FAULT: (
        "the controller reports a violation of its safety system, or a fault in it",
        "read the pendant's log, restart the safety system there, then reconnect",
    ),
    Fault.WATCHDOG: (
        "watchdog: the controller had no command for too long and stopped the arm",
        "close other programs, check the network, then reconnect, which sends the program and arms "
        "the watchdog anew",
    ),
    Fault.PROGRAM: (
        "program not running: the program on the controller has ended by itself, through a script "
        "error, another program, or somebody at the pendant",
        "read the pendant's log, switch to remote control, then reconnect",
    ),
    Fault.REFUSED: (
        "the controller refused a command without saying why",
        "read the pendant's log, then reconnect",
    ),
    Fault.LOST: (
        "the connection to the controller is lost, the arm stops by its watchdog",
        "check that the controller is on and its cable plugged in, then reconnect",
    ),
    Fault.DIED: (
        "worker died: the process that talks to the controller crashed or was killed, the arm "
        "stops by its watchdog",
        "note what it printed, then reconnect, which makes a new one",
    ),
}
"""What happened, and the cure."""


def error(fault: Fault) -> RobotError:
    """The fault as an error that says what to do; its value is the fault."""
    what, cure = WORDS[fault]
    return RobotError(f"{what}: {cure}", fault)


def diagnose(safety_bits: int, runtime_state: int) -> Fault:
    """What the controller's own words say, the graver first."""

    def is_set(*bits: int) -> bool:
        return any(safety_bits >> bit & 1 for bit in bits)

    if is_set(EMERGENCY_BIT, SYSTEM_EMERGENCY_BIT, ROBOT_EMERGENCY_BIT):
        return Fault.EMERGENCY_STOP
    if is_set(PROTECTIVE_BIT):
        return Fault.PROTECTIVE_STOP
    if is_set(SAFEGUARD_BIT):
        return Fault.SAFEGUARD_STOP
    if is_set(VIOLATION_BIT, FAULT_BIT):
        return Fault.SAFETY_FAULT
    return Fault.NONE if runtime_state == RUNNING else Fault.PROGRAM
