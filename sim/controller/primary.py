"""Messages of the primary and secondary interfaces (ports 30001, 30002), binary, big-endian
[UR-primary].
"""

import struct

from sim.controller.messages import Message, ProgramError

PORTS = (30001, 30002)
ROBOT_MESSAGE, RUNTIME_EXCEPTION = 20, 10
"""Types of a package, and of a message in it."""
CONTROLLER = -2
"""Source of a message."""
HEAD = struct.Struct(">iBQbb")
LINE_AND_COLUMN = struct.Struct(">ii")


def package(time: float, message: Message) -> bytes:
    """A message on the wire; nothing where it has no form yet.

    Args:
        time: Of the controller [s].
        message: What is told.
    """
    if not isinstance(message, ProgramError):
        return b""
    body = LINE_AND_COLUMN.pack(message.line, message.column) + message.text.encode()
    head = HEAD.pack(
        HEAD.size + len(body), ROBOT_MESSAGE, round(time * 1e6), CONTROLLER, RUNTIME_EXCEPTION
    )
    return head + body
