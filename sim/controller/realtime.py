"""What port 30003 tells, all of it doubles behind the message's size, big-endian [UR-realtime]."""

import struct

from sim.controller.controller import Controller
from sim.controller.outputs import Layout, Outputs

PORTS = (30003, 30013)
"""The second one takes no programs."""
HEAD = struct.Struct(">i")
WITH_PAYLOAD = (5, 10)
"""First version whose message is longer."""

_FIELDS = """timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd
    actual_current joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force
    target_TCP_pose target_TCP_speed actual_digital_input_bits joint_temperatures
    actual_execution_time =0 robot_mode joint_mode safety_mode =0 =0 =0 =0 =0 =0
    actual_tool_accelerometer =0 =0 =0 =0 =0 =0 speed_scaling actual_momentum =0 =0
    actual_main_voltage actual_robot_voltage actual_robot_current actual_joint_voltage
    actual_digital_output_bits runtime_state elbow_position elbow_velocity safety_status"""
"""1116 bytes."""
_PAYLOAD = " =0 =0 =0 payload payload_cog payload_inertia"
"""1220 bytes with these."""


class Realtime:
    """Packs it."""

    def __init__(self, controller: Controller, outputs: Outputs) -> None:
        longer = controller.config.numbers[:2] >= WITH_PAYLOAD
        fields = (_FIELDS + _PAYLOAD if longer else _FIELDS).split()
        self._layout = Layout(" ".join(f"{outputs.width(f)}d:{f}" for f in fields), outputs)
        self._head = HEAD.pack(HEAD.size + self._layout.size)

    def package(self) -> bytes:
        """The state of this period."""
        return self._head + self._layout.pack()
