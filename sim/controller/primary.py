"""Messages of the primary and secondary interfaces (ports 30001, 30002), binary, big-endian
[UR-primary].
"""

import struct

PORTS = (30001, 30002)
ROBOT_MESSAGE, RUNTIME_EXCEPTION = 20, 10
"""Types of a package, and of a message in it."""
CONTROLLER = -2
"""Source of a message."""
HEAD = struct.Struct(">iBQbb")
LINE_AND_COLUMN = struct.Struct(">ii")


def runtime_exception(time: float, line: int, text: str) -> bytes:
    """What ended a program.

    Args:
        time: Of the controller [s].
        line: In the program.
        text: What went wrong.
    """
    body = LINE_AND_COLUMN.pack(line, 0) + text.encode()
    head = HEAD.pack(
        HEAD.size + len(body), ROBOT_MESSAGE, round(time * 1e6), CONTROLLER, RUNTIME_EXCEPTION
    )
    return head + body
