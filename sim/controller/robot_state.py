"""The state that ports 30001 and 30002 tell ten times a second, binary, big-endian [UR-primary]."""

import struct
import zlib

import numpy as np
from jaxtyping import Float

from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.kinematics import DH_A, DH_ALPHA, DH_D
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, SPEED_LIMIT
from sim.controller import primary
from sim.controller.controller import Controller
from sim.controller.outputs import Layout, Outputs

PORTS = (*primary.PORTS, 30002, 30012)
RATE = 10.0
"""[Hz]"""
ROBOT_STATE = 16
"""Type of the package."""
KINEMATICS, CONFIGURATION = 5, 6
"""Types of those parts that come on connecting alone."""
LINEARIZED = 2
"""Status of a calibrated arm [UR-client]."""
HEAD = struct.Struct(">iB")
ROBOT_TYPES = {"UR3": 3, "UR5": 1, "UR10": 2, "UR16": 4, "UR20": 7, "UR30": 8}
MAX_ACCELERATION = 40.0
"""Of a joint [rad/s^2] [UR-script]."""
DEFAULTS = (1.05, 1.4, 0.25, 1.2, 1.0)
"""Speed and acceleration of a joint and of the tool that a program need not say [UR-script], and
the radius that rotations count at (assumed)."""
BOARDS = {True: (31, 2), False: (3, 1)}
"""Versions of the e-Series' masterboard and box, and of the older one's (assumed)."""

_JOINT = """d:actual_q d:target_q d:actual_qd f:actual_current f:actual_joint_voltage
    f:joint_temperatures f:joint_temperatures B:joint_mode"""
"""Once for each joint."""
_PARTS = {
    0: """Q:microseconds ?:=1 ?:=1 ?:is_powered ?:is_emergency_stopped ?:is_protective_stopped
        ?:is_playing ?:is_paused b:robot_mode B:control_mode d:target_speed_fraction
        d:speed_scaling d:=1.0 B:=0""",
    2: """B:=0 B:=0 d:tool_analog_input0 d:tool_analog_input1 f:actual_robot_voltage
        B:tool_output_voltage f:tool_output_current f:tool_temperature B:tool_mode""",
    3: """I:actual_digital_input_bits I:actual_digital_output_bits B:=0 B:=0
        d:standard_analog_input0 d:standard_analog_input1 B:=0 B:=0 d:standard_analog_output0
        d:standard_analog_output1 f:joint_temperature f:actual_robot_voltage
        f:actual_robot_current f:io_current B:safety_mode ?:=0 ?:=0 I:=0 B:=0 B:=0 B:=0""",
    4: "6d:actual_TCP_pose 6d:tcp_offset",
    7: "6d:actual_TCP_force d:=0.0",
    8: "B:=0 ?:freedrive ?:=1 B:=0",
    9: "6d:=0.0",
}
"""Type of each part, and what stands in it; what UR keeps to itself is zero here, or missing."""
_TOOL_PARTS = {
    11: "?:=0 i:=115200 i:=0 i:=1 f:=1.5 f:=3.5",
    12: "B:tool_output_mode B:tool_digital_output0_mode B:tool_digital_output1_mode",
}
"""Of the e-Series: the tool's serial line and outputs."""


class RobotState:
    """Packs it."""

    def __init__(self, controller: Controller, outputs: Outputs) -> None:
        self._controller = controller
        parts = _PARTS | (_TOOL_PARTS if controller.config.e_series else {})
        self._parts = [(number, Layout(text, outputs)) for number, text in parts.items()]
        self._joints = outputs.reader([field.split(":")[1] for field in _JOINT.split()])
        self._joint = struct.Struct(">" + "".join(field[0] for field in _JOINT.split()))

    def package(self) -> bytes:
        """What comes all the time."""
        parts = [_part(number, layout.pack()) for number, layout in self._parts]
        return _state([parts[0], _part(1, self._joint_data()), *parts[1:]])

    def greeting(self) -> bytes:
        """What a client gets on connecting: the version, and a state with what never changes."""
        config = self._controller.config
        arm = dh_parameters(self._controller.robot.calibration)
        checksums = [zlib.crc32(column.tobytes()) for column in arm.T]
        kinematics = struct.pack(">6I24dI", *checksums, *arm.ravel(), LINEARIZED)
        nominal = np.concatenate([DH_A, DH_D, DH_ALPHA, np.zeros(6)])
        setup = struct.pack(
            ">24d5d24d4i",
            *(-ANGLE_LIMIT, ANGLE_LIMIT) * 6,
            *(SPEED_LIMIT, MAX_ACCELERATION) * 6,
            *DEFAULTS,
            *nominal,
            *BOARDS[config.e_series],
            ROBOT_TYPES.get(config.model, ROBOT_TYPES["UR5"]),
            0,
        )
        state = self.package()[HEAD.size :]
        return primary.version(self._controller.time, config.numbers) + _state(
            [state, _part(KINEMATICS, kinematics), _part(CONFIGURATION, setup)]
        )

    def _joint_data(self) -> bytes:
        numbers = self._joints()
        return b"".join(self._joint.pack(*numbers[j::6]) for j in range(6))


def dh_parameters(arm: KinematicCalibration) -> Float[np.ndarray, "4 6"]:
    """What an arm's DH parameters really are, as its controller tells them: theta [rad], a [m],
    d [m] and alpha [rad], a row each.
    """
    links = [*arm.X_joints[1:], arm.X_6F]
    first = arm.X_joints[0]
    turns = [np.arctan2(first[1, 0], first[0, 0])]
    turns += [np.arctan2(-X[0, 1], X[0, 0]) for X in links[:-1]]
    return np.array(
        [
            turns,
            [X[0, 3] for X in links],
            [X[2, 3] for X in links],
            [np.arctan2(-X[1, 2], X[2, 2]) for X in links],
        ]
    )


def _part(number: int, body: bytes) -> bytes:
    return HEAD.pack(HEAD.size + len(body), number) + body


def _state(parts: list[bytes]) -> bytes:
    return _part(ROBOT_STATE, b"".join(parts))
