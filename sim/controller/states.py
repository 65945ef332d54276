"""The words in which a controller tells its state on the wire."""

from enum import Enum, IntEnum

from sim.controller.messages import Code


class Runtime(IntEnum):
    """Of the program."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


class RobotMode(IntEnum):
    """Of the arm."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7


class Safety(IntEnum):
    """Of the safety system."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


EMERGENCY_STOPS = (Safety.SYSTEM_EMERGENCY_STOP, Safety.ROBOT_EMERGENCY_STOP)
SAFETY_BITS = {
    Safety.NORMAL: 0x001,
    Safety.REDUCED: 0x002,
    Safety.PROTECTIVE_STOP: 0x404,
    Safety.RECOVERY: 0x008,
    Safety.SAFEGUARD_STOP: 0x410,
    Safety.SYSTEM_EMERGENCY_STOP: 0x4A0,
    Safety.ROBOT_EMERGENCY_STOP: 0x4C0,
    Safety.VIOLATION: 0x500,
    Safety.FAULT: 0x600,
}
"""Bits of `safety_status_bits`: 0 normal, 1 reduced, 2 protective, 3 recovery, 4 safeguard, 5
system, 6 robot and 7 any emergency stop, 8 violation, 9 fault, 10 stopped for safety
[UR-rtde-guide]."""


class Cause(Enum):
    """Why the arm was stopped, as the maker numbers it: code and argument [UR-codes]."""

    JOINT_RANGE = 150, 0
    DEVIATION = 153, 0
    SINGULARITY = 154, 0
    COLLISION = 157, 0
    RANGE_VIOLATED = 191, 1
    TOOL_SPEED_VIOLATED = 191, 3
    JOINT_SPEED_VIOLATED = 191, 32
    JUMP = 204, 1
    SETPOINT = 204, 5
    NEARING = 204, 7
    REQUESTED = 209, 0

    @property
    def violates(self) -> bool:
        """Whether a limit of the safety system was passed: power is cut then."""
        return self.value[0] == Cause.RANGE_VIOLATED.value[0]

    def code(self, text: str, joint: int) -> Code:
        """To tell; `joint` counts from 0, and adds to the argument of those that name one."""
        number, argument = self.value
        return Code(number, argument + joint, text)


POWERING_UP = (
    RobotMode.POWER_OFF,
    RobotMode.POWER_ON,
    RobotMode.BOOTING,
    RobotMode.IDLE,
    RobotMode.RUNNING,
)
"""One after the other."""
JOINT_MODES: dict[RobotMode, int] = dict(zip(POWERING_UP, (239, 245, 247, 255, 253), strict=True))
"""`joint_mode` in each."""
