"""The functions of sockets; their times are simulated ones [UR-script, "Module interfaces"]."""

import math
import struct
from collections.abc import Callable, Generator, Iterable
from functools import partial
from typing import Any

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.controller import Controller
from sim.controller.sockets import LONGEST_MESSAGE, Connection
from sim.controller.urscript.signature import (
    ANYTHING,
    CONDITION,
    INTEGER,
    NUMBER,
    REFUSED,
    TEXT,
    Function,
    Parameter,
    row,
    whole,
)
from sim.controller.urscript.values import Value, as_text

CONNECT_TIME = 2.0
"""After which an attempt to connect has failed [s]."""
ANSWER_TIME = 2.0
"""The same for the answer to `socket_get_var` [s]."""
LONGEST_TIMEOUT = 1e6
"""From which on a read waits without end [s]."""
MOST_NUMBERS = 30
"""That are read at once."""
INTEGERS = 4
"""Bytes of an integer."""
ESCAPES = {"\\n": "\n", "\\r": "\r", "\\t": "\t"}
Take = Callable[[Connection], Any]
Reading = Generator[None, None, Any]


def socket_functions(controller: Controller) -> Iterable[Function]:
    """Their rows."""
    sockets = controller.sockets
    name = Parameter("socket_name", TEXT, "socket_0")
    timeout = Parameter("timeout", NUMBER, 2.0)
    number = Parameter("number", whole(1, MOST_NUMBERS))
    variable, escape = Parameter("name", TEXT), Parameter("interpret_escape", CONDITION, False)
    prefix, suffix = Parameter("prefix", TEXT, ""), Parameter("suffix", TEXT, "")
    address, port = Parameter("address", TEXT), Parameter("port", whole(1, 65535))

    def read(name: str, take: Take, timeout: float, failed: Value) -> Reading:
        """Until there is enough, or the time is over: a time of 0 never is."""
        periods = round(timeout / PERIOD) if 0 < timeout < LONGEST_TIMEOUT else math.inf
        try:
            while (value := sockets.read(name, take)) is None and periods > 0:
                if timeout > 0:
                    sockets.wait(name)
                periods -= 1
                yield
        except ConnectionError:
            yield  # a program that reads on and on does not stand still
            return failed
        finally:
            sockets.awaited.pop(name, None)
        return failed if value is None else value

    def numbers(size: int, code: str) -> Callable[..., Reading]:
        def call(number: int, name: str, timeout: float) -> Reading:
            def take(connection: Connection) -> Value | None:
                if len(connection.come) < size * number:
                    return None
                taken = connection.take(size * number)
                return (number, *struct.unpack(f">{number}{code}", taken))

            return read(name, take, timeout, (0, *[-1] * number))

        return call

    def read_floats(number: int, name: str, timeout: float) -> Reading:
        failed = (0, *[math.nan] * number)
        text = yield from read(name, _between(b"(", b")"), timeout, "")
        try:
            values = [float(part) for part in text.split(",")][:number]
        except ValueError:
            return failed
        return (len(values), *values, *[math.nan] * (number - len(values)))

    def read_string(
        name: str, prefix: str, suffix: str, interpret_escape: bool, timeout: float
    ) -> Reading:
        for written, meant in ESCAPES.items() if interpret_escape else ():
            prefix, suffix = prefix.replace(written, meant), suffix.replace(written, meant)
        return read(name, _between(_bytes(prefix.lstrip(" ")), _bytes(suffix)), timeout, "")

    def read_line(name: str, timeout: float) -> Reading:
        line = yield from read(name, _between(b"", b"\n"), timeout, "")
        return line.removesuffix("\r")

    def get_variable(variable: str, name: str) -> Reading:
        sockets.send(name, _bytes(f"GET {variable}\n"))
        line = yield from read(name, _between(_bytes(f"{variable} "), b"\n"), ANSWER_TIME, "0")
        try:
            value = INTEGER.take(int(line))
        except ValueError:
            return 0
        return 0 if value is REFUSED else value

    def send(encode: Callable[..., bytes]) -> Callable[..., bool]:
        return lambda *values: sockets.send(values[-1], encode(*values[:-1]))

    sent: dict[str, tuple[Callable[..., bytes], tuple[Parameter, ...]]] = {
        "socket_send_byte": (lambda v: bytes([v]), (Parameter("value", whole(0, 255)),)),
        "socket_send_int": (struct.Struct(">i").pack, (Parameter("value", INTEGER),)),
        "socket_send_line": (lambda s: _bytes(as_text(s) + "\n"), (Parameter("str", ANYTHING),)),
        "socket_send_string": (lambda s: _bytes(as_text(s)), (Parameter("str", ANYTHING),)),
        "socket_set_var": (
            lambda name, v: _bytes(f"SET {name} {v}\n"),
            (variable, Parameter("value", INTEGER)),
        ),
    }
    reads = (
        row("socket_read_ascii_float", read_floats, number, name, timeout),
        row("socket_read_binary_integer", numbers(INTEGERS, "i"), number, name, timeout),
        row("socket_read_byte_list", numbers(1, "B"), number, name, timeout),
        row("socket_read_line", read_line, name, timeout),
        row("socket_read_string", read_string, name, prefix, suffix, escape, timeout),
        row("socket_get_var", get_variable, variable, name),
        row("socket_open", partial(connected, controller), address, port, name),
    )
    yield from (row(r.name, r.call, *r.parameters, waits=True) for r in reads)
    for function, (encode, values) in sent.items():
        yield row(function, send(encode), *values, name, costly=True)
    yield row("socket_close", sockets.close, name, costly=True)


def connected(controller: Controller, address: str, port: int, name: str) -> Reading:
    """Open a socket to the machine that the program came from; whether it is open then."""
    sender = controller.program_from
    opened = yield from controller.sockets.opened(name, address, port, sender, CONNECT_TIME)
    return opened is not None


def _between(prefix: bytes, suffix: bytes) -> Take:
    """Takes what stands between two marks, and all before it; without a last one, all there is."""

    def take(connection: Connection) -> str | None:
        start = connection.come.find(prefix)
        if start < 0:
            connection.take(max(len(connection.come) - len(prefix) + 1, 0))
            return None
        begin = start + len(prefix)
        come = len(connection.come)
        if not suffix and come > begin:
            return connection.take(min(come, begin + LONGEST_MESSAGE))[begin:].decode("latin-1")
        end = connection.come.find(suffix, begin) if suffix else -1
        if end < 0 and come - begin > LONGEST_MESSAGE:  # no string is so long
            connection.take(come)
        if end < 0:
            return None
        return connection.take(end + len(suffix))[begin:end][:LONGEST_MESSAGE].decode("latin-1")

    return take


def _bytes(text: str) -> bytes:
    return text.encode("latin-1", "replace")
