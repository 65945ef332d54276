"""The node External Control: a program that whoever presses play brings along.

As the maker's URCap does it: the controller asks at the client's port 50002, and what comes until
nothing more comes is the program [UR-external-control].
"""

from collections.abc import Callable, Generator

from sim.controller.sockets import KEPT, Sockets
from sim.controller.urscript.values import ScriptError

PROGRAM = "external_control.urp"
"""Holds the node and nothing else; always there."""
PORT = 50002
REQUEST = b"request_program\n"
CONNECT_TIME, ANSWER_TIME = 5.0, 0.5
"""For a connection, and for a first piece of the program [s], as the URCap waits."""
PAUSE = 0.2
"""After which no other piece comes [s]; assumed: the URCap takes what is there at once."""
LONGEST_PROGRAM = 1_000_000
"""Bytes."""


def requested(address: str, time: Callable[[], float]) -> Generator[None, None, str]:
    """Ask a machine for its program, a piece a turn, without waiting; the whole program.

    Args:
        address: Of the machine, in numbers.
        time: Since the controller was switched on [s].

    Raises:
        ScriptError: There is none, or it is too long.
    """
    sockets = Sockets()
    try:
        connection = yield from sockets.opened(PROGRAM, address, PORT, address, CONNECT_TIME)
        if connection is None or not sockets.send(PROGRAM, REQUEST):
            raise ScriptError(
                f"nobody listens at port {PORT} of {address}, from where play was pressed: start "
                "the client that brings the program first",
                address,
            )
        text, end = bytearray(), time() + ANSWER_TIME
        while time() < end and not connection.ended and len(text) <= LONGEST_PROGRAM:
            connection.receive()
            if connection.come:
                text += connection.take(KEPT)
                end = time() + PAUSE
            yield
    finally:
        sockets.close_all()
    if not 0 < len(text) <= LONGEST_PROGRAM:
        raise ScriptError(
            f"expected a program of 1 to {LONGEST_PROGRAM} bytes from port {PORT} of {address} "
            f"within {ANSWER_TIME} s, got {len(text)} bytes",
            address,
        )
    return f"def external_control():\n{text.decode('utf-8', 'replace')}\nend\n"
