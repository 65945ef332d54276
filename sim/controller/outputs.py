"""What the controller tells of itself, variable by variable, computed only where a client has
asked for it.
"""

from collections.abc import Callable, Sequence
from typing import Any

from sim.controller.controller import Controller
from sim.controller.states import JOINT_OFF, JOINT_RUNNING, SAFETY_BITS, RobotMode, Runtime
from sim.controller.urscript.values import Pose
from sim.controller.variables import OUTPUTS, REGISTERS, zero

VOLTAGE = 48.0
CURRENT = 1.0
TEMPERATURE = 30.0
"""Of the power supply [V], [A], and of the joints [°C]: any sound values."""
TORQUE_CONSTANT = 10.0
"""Joint torque over motor current [N m/A], roughly."""


class Outputs:
    """Reads variables from a controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._period = -1
        self._known: dict[str, Any] = {}
        """Values of this period: several clients ask for the same ones, and the poses are half of a
        cycle's work."""
        self._frozen: tuple[list[float], list[float]] | None = None
        self._readers = self._constants() | self._registers() | self._arm() | self._states()

    def reader(self, names: Sequence[str]) -> Callable[[], list[float]]:
        """A function that gives the numbers of these variables, vectors written out."""
        readers = [
            (name, self._readers[name], isinstance(zero(OUTPUTS[name]), list)) for name in names
        ]

        def read() -> list[float]:
            numbers: list[float] = []
            known = self._of_this_period()
            for name, value, is_vector in readers:
                if name not in known:
                    known[name] = value()
                numbers.extend(known[name]) if is_vector else numbers.append(known[name])
            return numbers

        return read

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
        return readers

    def _arm(self) -> dict[str, Callable]:
        c, robot = self._controller, self._controller.robot

        def currents() -> list[float]:
            return (robot.drive_torques() / TORQUE_CONSTANT).tolist()

        return {
            "target_q": lambda: robot.commanded[0].tolist(),
            "target_qd": lambda: robot.commanded[1].tolist(),
            "target_qdd": lambda: robot.commanded_acceleration.tolist(),
            "actual_q": lambda: c.state.q.tolist(),
            "actual_qd": lambda: c.state.qd.tolist(),
            "target_moment": lambda: robot.drive_torques().tolist(),
            "actual_current_as_torque": lambda: robot.drive_torques().tolist(),
            **dict.fromkeys(("target_current", "actual_current", "joint_control_output"), currents),
            "actual_TCP_pose": lambda: Pose.of(c.tool_pose(c.state.q)),
            "target_TCP_pose": lambda: Pose.of(c.tool_pose(robot.commanded[0])),
            "actual_TCP_speed": lambda: c.tool_speed(c.state.q, c.state.qd).tolist(),
            "target_TCP_speed": lambda: c.tool_speed(*robot.commanded).tolist(),
            "actual_TCP_force": self._wrench,
            "ft_raw_wrench": self._raw_wrench,
            "tcp_offset": lambda: Pose.of(c.X_FT),
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
            "standard_analog_output0": lambda: c.analog_outputs[0],
            "standard_analog_output1": lambda: c.analog_outputs[1],
            "actual_digital_output_bits": lambda: c.digital_outputs,
            "robot_mode": lambda: int(c.mode),
            "safety_mode": lambda: int(c.safety),
            "safety_status": lambda: int(c.safety),
            "joint_mode": lambda: [JOINT_RUNNING if c.mode is RobotMode.RUNNING else JOINT_OFF] * 6,
            "runtime_state": lambda: int(c.runtime),
            "robot_status_bits": lambda: (
                (0 if c.mode is RobotMode.POWER_OFF else 1) | 2 * (c.runtime is Runtime.PLAYING)
            ),
            "safety_status_bits": lambda: SAFETY_BITS[c.safety],
        }
