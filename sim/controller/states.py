"""The words in which a controller tells its state on the wire."""

from enum import IntEnum


class Runtime(IntEnum):
    """Of the program."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


class RobotMode(IntEnum):
    """Of the arm."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


class Safety(IntEnum):
    """Of the safety system."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7
    FAULT = 9


SAFETY_BITS = {
    Safety.NORMAL: 0x001,
    Safety.PROTECTIVE_STOP: 0x404,
    Safety.ROBOT_EMERGENCY_STOP: 0x4C0,
    Safety.FAULT: 0x600,
}
"""Bits of `safety_status_bits`: 0 normal, 2 protective, 6 robot and 7 any emergency stop, 9 fault,
10 stopped for safety."""
JOINT_RUNNING, JOINT_OFF = 253, 239
"""Of `joint_mode`."""
