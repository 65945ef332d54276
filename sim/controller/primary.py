"""Messages of the primary interface (port 30001), binary, big-endian [UR-primary]: the version on
connecting, and whatever the controller tells. `robot_state` holds what comes ten times a second.
"""

import struct
from collections.abc import Callable
from typing import Any

from sim.controller.messages import (
    Code,
    Key,
    Message,
    Popup,
    ProgramError,
    SafetyChange,
    Text,
)

PORTS = (30001, 30011)
"""The second one takes no programs."""
ROBOT_MESSAGE = 20
"""Type of the package."""
VERSION, RUNTIME_EXCEPTION = 3, 10
"""Types of messages."""
CONTROLLER = -2
"""Source of a message."""
HEAD = struct.Struct(">iBQbb")
INFO, WARNING = 1, 2
"""Levels of a numbered message; a protective stop is a warning."""
NO_DATA = (0, 0)
"""Type of what a message carries besides, and its value."""
PROJECT, BUILD_DATE = b"URControl", b"01-01-2025, 00:00:00"
LONGEST_TITLE, LONGEST_TEXT = 255, 1500
"""Bytes; a client in use takes a package above 2000 for none."""


def package(time: float, message: Message) -> bytes:
    """A message on the wire.

    Args:
        time: Of the controller [s].
        message: What is told.
    """
    number, body = _BODIES[type(message)]
    return _framed(time, number, body(message))


def version(time: float, numbers: tuple[int, int, int, int]) -> bytes:
    """The message with the version of the software: major, minor, bug fix, build."""
    body = struct.pack(">b", len(PROJECT)) + PROJECT + struct.pack(">BBii", *numbers)
    return _framed(time, VERSION, body + BUILD_DATE)


def _framed(time: float, number: int, body: bytes) -> bytes:
    size = HEAD.size + len(body)
    return HEAD.pack(size, ROBOT_MESSAGE, round(time * 1e6), CONTROLLER, number) + body


def _text(text: str) -> bytes:
    return text.encode("latin-1", "replace")[:LONGEST_TEXT]


def _titled(title: str, text: str) -> bytes:
    words = title.encode("latin-1", "replace")[:LONGEST_TITLE]
    return struct.pack(">B", len(words)) + words + _text(text)


def _popup(message: Popup) -> bytes:
    kinds = (message.warning, message.error, message.blocking)
    return struct.pack(">IB3?", 0, 0, *kinds) + _titled(message.title, message.text)


def _code(message: Code) -> bytes:
    level = WARNING if message.stops else INFO
    head = struct.pack(">iii2I", message.code, message.argument, level, *NO_DATA)
    return head + _text(message.text)


_BODIES: dict[type, tuple[int, Callable[[Any], bytes]]] = {
    Text: (0, lambda m: _text(m.text)),
    Popup: (2, _popup),
    SafetyChange: (5, lambda m: struct.pack(">iiB2I", 0, 0, m.mode, *NO_DATA)),
    Code: (6, _code),
    Key: (7, lambda m: struct.pack(">ii", 0, 0) + _titled(m.title, m.text)),
    ProgramError: (
        RUNTIME_EXCEPTION,
        lambda m: struct.pack(">ii", m.line, m.column) + _text(m.text),
    ),
}
"""Type of each message, and what stands in it."""
