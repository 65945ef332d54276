"""The variables of RTDE, with their types on the wire: names and widths as Universal Robots
documents them.

A client decodes by its own table, so one wrong width would shift every field behind it.
"""

import struct
from collections.abc import Sequence
from functools import cache

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
Held = bool | int | float | list[float]
"""What a variable holds."""
REGISTERS = 48
"""Integer and double registers, each way."""

BITS = 128
"""Boolean registers, each way."""
BIT_WORDS = {
    way: (f"{way}_bit_registers0_to_31", f"{way}_bit_registers32_to_63")
    for way in ("input", "output")
}
"""The first 64 of them go by words of 32, the others one by one."""

_OUTPUTS = {
    "VECTOR6D": """target_q target_qd target_qdd target_current target_moment actual_q actual_qd
        actual_current actual_current_window joint_control_output actual_TCP_pose actual_TCP_speed
        actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures actual_joint_voltage
        ft_raw_wrench payload_inertia tcp_offset actual_current_as_torque actual_TCP_acceleration
        target_TCP_acceleration wrench_calc_from_currents target_base_acceleration
        target_base_wrench""",
    "DOUBLE": """timestamp actual_execution_time target_execution_time speed_scaling
        target_speed_fraction actual_momentum actual_main_voltage actual_robot_voltage
        actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0
        standard_analog_output1 io_current payload tool_temperature tool_output_current
        tool_analog_input0 tool_analog_input1 tcp_force_scalar joint_position_deviation_ratio
        collision_detection_ratio actual_robot_energy_consumed
        actual_robot_braking_energy_dissipated euromap67_24V_voltage euromap67_24V_current""",
    "VECTOR3D": """actual_tool_accelerometer payload_cog elbow_position elbow_velocity
        target_gravity""",
    "UINT64": """actual_digital_input_bits actual_digital_output_bits
        actual_configurable_digital_input_bits actual_configurable_digital_output_bits
        control_step""",
    "INT32": """robot_mode safety_mode safety_status tool_output_voltage encoder0_raw encoder1_raw
        time_scale_source""",
    "VECTOR6INT32": "joint_mode",
    "UINT32": """runtime_state robot_status_bits safety_status_bits analog_io_types tool_mode
        tool_analog_input_types output_bit_registers0_to_31 output_bit_registers32_to_63
        script_control_line euromap67_input_bits euromap67_output_bits""",
    "UINT8": "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
}
_SINCE = {
    ("5.2", "10.0"): "tool_output_mode tool_digital_output0_mode tool_digital_output1_mode",
    ("5.9", "10.0"): "ft_raw_wrench",
    ("5.15", "10.0"): "collision_detection_ratio",
    ("5.17", "10.3"): "time_scale_source",
    ("5.23", "10.11"): """actual_robot_energy_consumed actual_robot_braking_energy_dissipated
        actual_current_as_torque actual_TCP_acceleration target_TCP_acceleration
        wrench_calc_from_currents""",
    ("5.26", "10.12"): "target_gravity target_base_acceleration",
    ("5.26", "10.13"): "control_step target_base_wrench",
}
"""Outputs that came later, and with which software of the e-Series and of PolyScope X; the older
series never had them [UR-rtde-guide] [UR-client]. What no source dates is there in every version.
"""
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
    return ints | doubles | {f"{direction}_bit_register_{i}": "BOOL" for i in range(64, BITS)}


INPUTS = _by_name(_INPUTS) | _registers("input")
"""What a client may write."""
OUTPUTS = (
    _by_name(_OUTPUTS)
    | _registers("output")
    | _registers("input")
    | {name: _by_name(_INPUTS)[name] for name in BIT_WORDS["input"]}
)
"""All that a client may ask for, in some version; what it wrote can be read back."""


@cache
def offered(numbers: tuple[int, ...]) -> dict[str, str]:
    """The outputs of one version of the software (major, minor, ...), with their types."""
    missing = " ".join(
        names
        for since, names in _SINCE.items()
        if not any(_numbers(v)[0] == numbers[0] and _numbers(v) <= numbers[:2] for v in since)
    ).split()
    return {name: kind for name, kind in OUTPUTS.items() if name not in missing}


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


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

    def unpack(self, package: bytes) -> dict[str, Held]:
        """The variables in a package; what it has too much is left alone."""
        numbers = self._struct.unpack_from(package)
        start = 0
        found = {}
        for name, width in zip(self.names, self.widths, strict=True):
            found[name] = numbers[start] if width == 1 else list(numbers[start : start + width])
            start += width
        return found


def zero(kind: str) -> Held:
    """What a variable holds before it is written."""
    return [0.0] * WIDTHS[kind] if kind in WIDTHS else 0
