"""The variables of RTDE, with their types on the wire: names and widths as Universal Robots
documents them.

A client decodes by its own table, so one wrong width would shift every field behind it.
"""

import struct
from collections.abc import Sequence

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "INT32": "i",
    "UINT64": "Q",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""`struct` formats, big-endian without padding."""
WIDTHS = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}
"""Numbers in a field, where that is not one."""
REGISTERS = 48
"""Integer and double registers, each way."""

_OUTPUTS = {
    "VECTOR6D": """target_q target_qd target_qdd target_current target_moment actual_q actual_qd
        actual_current actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed
        actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage
        ft_raw_wrench payload_inertia tcp_offset actual_current_as_torque""",
    "DOUBLE": """timestamp actual_execution_time target_execution_time speed_scaling
        target_speed_fraction actual_momentum actual_main_voltage actual_robot_voltage
        actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0
        standard_analog_output1 io_current payload tool_temperature tool_output_current
        tool_analog_input0 tool_analog_input1""",
    "VECTOR3D": "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "INT32": "robot_mode safety_mode safety_status tool_output_voltage",
    "VECTOR6INT32": "joint_mode",
    "UINT32": """runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode
        tool_analog_input_types output_bit_registers0_to_31 output_bit_registers32_to_63
        script_control_line""",
    "UINT8": "tool_output_mode",
}
_INPUTS = {
    "UINT32": "speed_slider_mask input_bit_registers0_to_31 input_bit_registers32_to_63",
    "DOUBLE": "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    "UINT8": """standard_digital_output_mask standard_digital_output
        configurable_digital_output_mask configurable_digital_output tool_digital_output_mask
        tool_digital_output standard_analog_output_mask standard_analog_output_type""",
    "VECTOR6D": "external_force_torque",
}


def _by_name(groups: dict[str, str]) -> dict[str, str]:
    return {name: kind for kind, names in groups.items() for name in names.split()}


def _registers(direction: str) -> dict[str, str]:
    ints = {f"{direction}_int_register_{i}": "INT32" for i in range(REGISTERS)}
    doubles = {f"{direction}_double_register_{i}": "DOUBLE" for i in range(REGISTERS)}
    return ints | doubles | {f"{direction}_bit_register_{i}": "BOOL" for i in range(64, 128)}


INPUTS = _by_name(_INPUTS) | _registers("input")
"""What a client may write."""
OUTPUTS = _by_name(_OUTPUTS) | _registers("output") | _registers("input")
"""What a client may ask for; what it wrote can be read back."""


class Recipe:
    """An ordered choice of variables, and how they are packed."""

    def __init__(self, names: Sequence[str], kinds: Sequence[str]) -> None:
        self.names = list(names)
        self.widths = [WIDTHS.get(kind, 1) for kind in kinds]
        self._struct = struct.Struct(">" + "".join(FORMATS[kind] for kind in kinds))

    @property
    def size(self) -> int:
        """Bytes of a package."""
        return self._struct.size

    def pack(self, values: Sequence[float]) -> bytes:
        """A package of all numbers, vectors written out."""
        return self._struct.pack(*values)

    def unpack(self, package: bytes) -> dict[str, float | list[float]]:
        """The variables in a package; what it has too much is left alone."""
        numbers = self._struct.unpack_from(package)
        start = 0
        found = {}
        for name, width in zip(self.names, self.widths, strict=True):
            found[name] = numbers[start] if width == 1 else list(numbers[start : start + width])
            start += width
        return found


def zero(kind: str) -> float | list[float]:
    """What a variable holds before it is written."""
    return [0.0] * WIDTHS[kind] if kind in WIDTHS else 0
