"""The functions of inputs, outputs and registers [UR-script, "Module interfaces"].

Nothing is wired to the simulated controller: inputs are what a test sets, or stay 0.
"""

from collections.abc import Callable, Iterable

from sim.controller.controller import Controller
from sim.controller.urscript.signature import (
    CONDITION,
    INTEGER,
    NUMBER,
    REFUSED,
    Function,
    Kind,
    Parameter,
    row,
    up_to,
    whole,
)
from sim.controller.variables import BITS, REGISTERS

FLAGS = 32
DIGITAL = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}
"""First bit, and how many there are, of each kind of digital in- and output."""
FULL_LEVEL = (0.020, 10.0)
"""Of an analog output, as a current [A] and as a voltage [V]."""
VOLTAGES = (0, 12, 24)
VOLTAGE = Kind("0, 12 or 24", lambda value: int(value) if value in VOLTAGES else REFUSED)
LEVEL = Parameter("b", CONDITION)


def io_functions(controller: Controller) -> Iterable[Function]:
    """Their rows."""
    yield from _digital(controller)
    yield from _analog(controller)
    yield from _registers(controller)
    yield from _settings(controller)


def _bit(word: Callable[[], int], first: int) -> Callable[[int], bool]:
    return lambda n: bool(word() >> first + n & 1)


def _with_bit(word: int, at: int, on: bool) -> int:
    return word & ~(1 << at) | on << at


def _digital(controller: Controller) -> Iterable[Function]:
    def inputs() -> int:
        return controller.digital_inputs

    def outputs() -> int:
        return controller.digital_outputs

    def flags() -> int:
        return controller.flags

    def switch(first: int) -> Callable[[int, bool], None]:
        def call(n: int, on: bool) -> None:
            controller.digital_outputs = _with_bit(controller.digital_outputs, first + n, on)

        return call

    def set_flag(n: int, on: bool) -> None:
        controller.flags = _with_bit(controller.flags, n, on)

    for kind, (first, count) in DIGITAL.items():
        n = Parameter("n", whole(0, count - 1))
        yield row(f"get_{kind}_digital_in", _bit(inputs, first), n)
        yield row(f"get_{kind}_digital_out", _bit(outputs, first), n)
        yield row(f"set_{kind}_digital_out", switch(first), n, LEVEL)
    port = Parameter("n", whole(0, 9))
    yield row("get_digital_in", lambda n: _bit(inputs, _legacy(n))(0), port)
    yield row("get_digital_out", lambda n: _bit(outputs, _legacy(n))(0), port)
    yield row("set_digital_out", lambda n, on: switch(_legacy(n))(0, on), port, LEVEL)
    flag = Parameter("n", whole(0, FLAGS - 1))
    yield row("get_flag", _bit(flags, 0), flag)
    yield row("set_flag", set_flag, flag, LEVEL)


def _legacy(n: int) -> int:
    """Bit of a port of the older functions, whose last two are the tool's."""
    return n if n < 8 else n + 8


def _analog(controller: Controller) -> Iterable[Function]:
    def level(n: int) -> float:
        return controller.analog_outputs[n] * FULL_LEVEL[controller.analog_types >> 2 + n & 1]

    def set_level(n: int, share: float) -> None:
        controller.analog_outputs[n] = share

    def set_domain(first: int) -> Callable[[int, int], None]:
        def call(n: int, domain: int) -> None:
            types = controller.analog_types
            controller.analog_types = _with_bit(types, first + n, bool(domain))

        return call

    n, domain = Parameter("n", whole(0, 1)), Parameter("domain", whole(0, 1))
    share, port = Parameter("f", up_to(1.0)), Parameter("port", whole(0, 1))
    for name in ("get_standard_analog_out", "get_analog_out"):
        yield row(name, level, n)
    for name in ("set_standard_analog_out", "set_analog_out"):
        yield row(name, set_level, n, share)
    yield row("get_standard_analog_in", lambda n: controller.analog_inputs[n], n)
    yield row("get_tool_analog_in", lambda n: controller.analog_inputs[2 + n], n)
    yield row("get_analog_in", lambda n: controller.analog_inputs[n], Parameter("n", whole(0, 3)))
    firsts = {"set_standard_analog_input_domain": 0, "set_analog_outputdomain": 2,
              "set_tool_analog_input_domain": 4}  # fmt: skip
    yield from (row(name, set_domain(first), port, domain) for name, first in firsts.items())


def _registers(controller: Controller) -> Iterable[Function]:
    place = Parameter("address", whole(0, REGISTERS - 1))
    bit = Parameter("address", whole(0, BITS - 1))
    doubles, ints = (
        [f"input_{kind}_register_{i}" for i in range(REGISTERS)] for kind in ("double", "int")
    )

    def write_float(i: int, value: float) -> None:
        controller.out_doubles[i] = float(value)

    def write_integer(i: int, value: int) -> None:
        controller.out_ints[i] = value

    def write_bit(i: int, value: bool) -> None:
        controller.out_bits[i] = value

    yield row("read_input_float_register", lambda i: controller.read_input(doubles[i]), place)
    yield row("read_input_integer_register", lambda i: controller.read_input(ints[i]), place)
    yield row("read_input_boolean_register", controller.input_bit, bit)
    yield row("read_output_float_register", lambda i: controller.out_doubles[i], place)
    yield row("read_output_integer_register", lambda i: controller.out_ints[i], place)
    yield row("read_output_boolean_register", lambda i: controller.out_bits[i], bit)
    yield row("write_output_float_register", write_float, place, Parameter("value", NUMBER))
    yield row("write_output_integer_register", write_integer, place, Parameter("value", INTEGER))
    yield row("write_output_boolean_register", write_bit, bit, Parameter("value", CONDITION))


def _settings(controller: Controller) -> Iterable[Function]:
    """Of connectors with nothing in them: kept, and told where RTDE has a word for it."""

    def set_voltage(voltage: int) -> None:
        controller.tool_voltage = voltage

    def nothing(*_: object) -> None:
        """Is so, or has nothing to act on."""

    n, mode = Parameter("n", whole(0, 1)), Parameter("mode", whole(1, 3))
    yield row("set_tool_voltage", set_voltage, Parameter("voltage", VOLTAGE))
    yield row("set_tool_digital_output_mode", nothing, n, mode)
    yield row("set_tool_output_mode", nothing, Parameter("mode", whole(0, 1)))
    yield row("set_input_actions_to_default", nothing)
    line = {"enabled": CONDITION, "baud_rate": INTEGER, "parity": whole(0, 2),
            "stop_bits": whole(1, 2), "rx_idle_chars": NUMBER, "tx_idle_chars": NUMBER}  # fmt: skip
    yield row("set_tool_communication", nothing, *(Parameter(*each) for each in line.items()))
