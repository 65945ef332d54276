"""What the controller tells of itself, variable by variable, computed only where a client has
asked for it, and once a period.
"""

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from breastscan.geometry.kinematics import DH_A, DH_D
from sim.controller.controller import Controller
from sim.controller.states import (
    EMERGENCY_STOPS,
    JOINT_MODES,
    SAFETY_BITS,
    RobotMode,
    Runtime,
    Safety,
)
from sim.controller.variables import BIT_WORDS, BITS, OUTPUTS, REGISTERS, WIDTHS, zero

VOLTAGE = 48.0
CURRENT = 1.0
TEMPERATURE = 30.0
"""Of the power supply [V], [A], and of the joints [°C]: any sound values."""
TORQUE_CONSTANT = 10.0
"""Joint torque over motor current [N m/A], roughly."""
TOOL_RUNNING = 253
"""Of `tool_mode`."""
POSITION, FREEDRIVE = 0, 1
FORCE = 2
"""Of the control mode."""
CONSTANT = "="
"""Begins the name of what always has one value, as `=0`."""


class Outputs:
    """Reads variables from a controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._period = -1
        self._known: dict[str, Any] = {}
        """Values of this period: several clients ask for the same ones, and the poses are half of a
        cycle's work."""
        self._frozen: tuple[list[float], list[float]] | None = None
        self._readers = (
            self._constants()
            | self._registers()
            | self._inputs_and_outputs()
            | self._arm()
            | self._states()
            | self._streamed()
        )

    def reader(self, names: Sequence[str]) -> Callable[[], list[float]]:
        """A function that gives the numbers of these variables, vectors written out."""
        readers = [(name, self._reader(name), self.width(name) > 1) for name in names]

        def read() -> list[float]:
            numbers: list[float] = []
            known = self._of_this_period()
            for name, value, is_vector in readers:
                if name not in known:
                    known[name] = value()
                numbers.extend(known[name]) if is_vector else numbers.append(known[name])
            return numbers

        return read

    @staticmethod
    def width(name: str) -> int:
        """How many numbers a variable has."""
        return WIDTHS.get(OUTPUTS.get(name, ""), 1)

    def _reader(self, name: str) -> Callable[[], Any]:
        if not name.startswith(CONSTANT):
            return self._readers[name]
        text = name.removeprefix(CONSTANT)
        value = float(text) if "." in text else int(text)
        return lambda: value

    def freeze_wrench(self) -> None:
        """Tell the present wrench from now on: the sensor has died."""
        self._frozen = self._wrench(), self._raw_wrench()

    def _of_this_period(self) -> dict[str, Any]:
        if self._period != self._controller.periods:
            self._period = self._controller.periods
            self._known.clear()
        return self._known

    def _wrench(self) -> list[float]:
        return (
            self._controller.tool_wrench_B().tolist() if self._frozen is None else self._frozen[0]
        )

    def _raw_wrench(self) -> list[float]:
        return (
            self._controller.robot.reading_F().tolist() if self._frozen is None else self._frozen[1]
        )

    def _constants(self) -> dict[str, Callable]:
        """What never changes here, for a start all of them."""
        fixed = {name: zero(kind) for name, kind in OUTPUTS.items()} | {
            "actual_main_voltage": VOLTAGE,
            "actual_robot_voltage": VOLTAGE,
            "actual_robot_current": CURRENT,
            "actual_joint_voltage": [VOLTAGE] * 6,
            "joint_temperatures": [TEMPERATURE] * 6,
            "actual_tool_accelerometer": [0.0, 0.0, -9.81],
        }
        return {name: lambda value=value: value for name, value in fixed.items()}

    def _registers(self) -> dict[str, Callable]:
        c = self._controller
        readers: dict[str, Callable] = {}
        for i in range(REGISTERS):
            readers[f"output_int_register_{i}"] = lambda i=i: c.out_ints[i]
            readers[f"output_double_register_{i}"] = lambda i=i: c.out_doubles[i]
            for name in (f"input_int_register_{i}", f"input_double_register_{i}"):
                readers[name] = lambda name=name: c.inputs[name]
        for i in range(64, BITS):
            readers[f"output_bit_register_{i}"] = lambda i=i: c.out_bits[i]
            readers[f"input_bit_register_{i}"] = lambda i=i: c.input_bit(i)
        for k in range(2):
            word = BIT_WORDS["input"][k]
            readers[word] = lambda word=word: c.inputs[word]
            readers[BIT_WORDS["output"][k]] = lambda k=k: sum(
                bit << i for i, bit in enumerate(c.out_bits[32 * k : 32 * k + 32])
            )
        return readers

    def _inputs_and_outputs(self) -> dict[str, Callable]:
        c = self._controller
        analog = ("standard_analog_input0", "standard_analog_input1", "tool_analog_input0",
                  "tool_analog_input1")  # fmt: skip
        readers: dict[str, Callable] = {
            name: lambda i=i: c.analog_inputs[i] for i, name in enumerate(analog)
        }
        return readers | {
            "standard_analog_output0": lambda: c.analog_outputs[0],
            "standard_analog_output1": lambda: c.analog_outputs[1],
            "actual_digital_input_bits": lambda: c.digital_inputs,
            "actual_configurable_digital_input_bits": lambda: c.digital_inputs >> 8 & 0xFF,
            "actual_digital_output_bits": lambda: c.digital_outputs,
            "actual_configurable_digital_output_bits": lambda: c.digital_outputs >> 8 & 0xFF,
        }

    def _arm(self) -> dict[str, Callable]:
        c, robot = self._controller, self._controller.robot

        def torques() -> list[float]:
            return self._once("actual_current_as_torque")

        def currents() -> list[float]:
            return [torque / TORQUE_CONSTANT for torque in torques()]

        return {
            "target_q": lambda: robot.commanded[0].tolist(),
            "target_qd": lambda: robot.commanded[1].tolist(),
            "target_qdd": lambda: robot.commanded_acceleration.tolist(),
            "actual_q": lambda: c.state.q.tolist(),
            "actual_qd": lambda: c.state.qd.tolist(),
            "target_moment": torques,
            "actual_current_as_torque": lambda: robot.drive_torques().tolist(),
            **dict.fromkeys(("target_current", "actual_current", "joint_control_output"), currents),
            "actual_flange": lambda: robot.calibration.forward(c.state.q),
            "target_flange": lambda: robot.calibration.forward(robot.commanded[0]),
            "actual_TCP_pose": lambda: _numbers(self._once("actual_flange") @ c.X_FT),
            "target_TCP_pose": lambda: _numbers(self._once("target_flange") @ c.X_FT),
            "actual_TCP_speed": lambda: self._speed("actual_flange", c.state.q, c.state.qd),
            "target_TCP_speed": lambda: self._speed("target_flange", *robot.commanded),
            "actual_TCP_force": self._wrench,
            "tcp_force_scalar": lambda: math.hypot(*self._once("actual_TCP_force")[:3]),
            "ft_raw_wrench": self._raw_wrench,
            "elbow_position": lambda: _elbow(c.state.q, c.state.qd)[0],
            "elbow_velocity": lambda: _elbow(c.state.q, c.state.qd)[1],
            "tcp_offset": lambda: _numbers(c.X_FT),
            "payload": lambda: c.payload.mass,
            "payload_cog": lambda: c.payload.centre_F.tolist(),
            "payload_inertia": lambda: c.inertia,
        }

    def _states(self) -> dict[str, Callable]:
        c = self._controller
        return {
            "timestamp": lambda: c.time,
            "speed_scaling": lambda: c.scaling,
            "target_speed_fraction": lambda: c.slider,
            "robot_mode": lambda: int(c.mode),
            "safety_mode": lambda: int(c.safety),
            "safety_status": lambda: int(c.safety),
            "joint_mode": lambda: [JOINT_MODES[c.mode]] * 6,
            "tool_mode": lambda: 0 if c.mode is RobotMode.POWER_OFF else TOOL_RUNNING,
            "runtime_state": lambda: int(c.runtime),
            "robot_status_bits": lambda: (
                (c.mode is not RobotMode.POWER_OFF)
                | (c.runtime is Runtime.PLAYING) << 1
                | c.freedrive << 2
            ),
            "safety_status_bits": lambda: SAFETY_BITS[c.safety],
            "collision_detection_ratio": lambda: c.supervision.collision_ratio,
            "joint_position_deviation_ratio": lambda: max(c.supervision.deviation_ratio),
            "actual_robot_energy_consumed": lambda: VOLTAGE * CURRENT * c.time,
        }

    def _streamed(self) -> dict[str, Callable]:
        """What no RTDE variable tells, and other ports do."""
        c = self._controller
        return {
            "microseconds": lambda: round(c.time * 1e6),
            "is_powered": lambda: c.mode is not RobotMode.POWER_OFF,
            "is_emergency_stopped": lambda: c.safety in EMERGENCY_STOPS,
            "is_protective_stopped": lambda: c.safety is Safety.PROTECTIVE_STOP,
            "is_playing": lambda: c.runtime is Runtime.PLAYING,
            "is_paused": lambda: c.runtime is Runtime.PAUSED,
            "control_mode": lambda: (
                FREEDRIVE if c.freedrive else FORCE if c.compliance is not None else POSITION
            ),
            "freedrive": lambda: c.freedrive,
            "joint_temperature": lambda: TEMPERATURE,
        }

    def _speed(self, flange: str, q: np.ndarray, qd: np.ndarray) -> list[float]:
        """Linear and angular velocity of the tool in B [m/s, rad/s]."""
        c = self._controller
        x, y, z = (self._once(flange)[:3, :3] @ c.X_FT[:3, 3]).tolist()
        vx, vy, vz, wx, wy, wz = (c.robot.calibration.jacobian(q) @ qd).tolist()
        return [vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x, wx, wy, wz]

    def _once(self, name: str) -> Any:
        """A variable that others are made of."""
        known = self._of_this_period()
        if name not in known:
            known[name] = self._readers[name]()
        return known[name]


class Layout:
    """How variables stand in a package: words `format:variable` or `format:=constant`, with the
    formats of `struct`, big-endian without padding.
    """

    def __init__(self, text: str, outputs: Outputs) -> None:
        fields: list[tuple[str, str]] = []
        for word in text.split():
            kind, _, name = word.partition(":")
            count = int(kind[:-1] or 1)
            repeated = name.startswith(CONSTANT)
            fields += [(kind[-1], name)] * count if repeated else [(kind, name)]
        self._struct = struct.Struct(">" + "".join(kind for kind, _ in fields))
        self._read = outputs.reader([name for _, name in fields])

    @property
    def size(self) -> int:
        """Bytes of a package."""
        return self._struct.size

    def pack(self) -> bytes:
        """The package of this period."""
        return self._struct.pack(*self._read())


def _numbers(X: np.ndarray) -> list[float]:
    """A pose as position and rotation vector [m, rad]: SciPy takes twenty times as long for one."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = X.tolist()
    # a quaternion, by the largest of its components, which alone is no difference of near numbers
    squares = (1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i)
    k = squares.index(max(squares))
    w, p, q, r = (
        (squares[0], h - f, c - g, d - b),
        (h - f, squares[1], b + d, c + g),
        (c - g, b + d, squares[2], f + h),
        (d - b, c + g, f + h, squares[3]),
    )[k]
    sine = math.sqrt(p * p + q * q + r * r)
    scale = 2.0 * math.atan2(sine, abs(w)) / sine * (1 if w >= 0 else -1) if sine else 0.0
    return [x, y, z, scale * p, scale * q, scale * r]


def _elbow(q: np.ndarray, qd: np.ndarray) -> tuple[list[float], list[float]]:
    """Position and velocity of the nominal arm's elbow in B [m, m/s]."""
    c1, s1 = math.cos(q[0]), math.sin(q[0])
    radius, height = DH_A[1] * math.cos(q[1]), DH_A[1] * math.sin(q[1])
    outwards = -height * qd[1]
    return (
        [c1 * radius, s1 * radius, DH_D[0] + height],
        [
            c1 * outwards - s1 * radius * qd[0],
            s1 * outwards + c1 * radius * qd[0],
            radius * qd[1],
        ],
    )
