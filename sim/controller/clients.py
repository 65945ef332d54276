"""Accepted connections: what comes in is bounded, what goes out never waits, and who does not
read is dropped.
"""

import re
import socket
import time
from collections.abc import Callable

from sim.controller.rtde import Connection

CHUNK = 1024
"""Bytes that are taken from a client at once: a flood of short lines then leaves the others their
turn."""
SEND_BUFFER = 131072
"""Bytes that the system keeps for a client that is late."""
NOT_READING = 10.0
"""A client that takes nothing for so long is dropped [s], as the robot does."""
LONGEST_LINE = 65536
"""Bytes of a line, where lines are answered."""
PRINTABLE = 0x21
"""From here on a first byte is a letter's, and not of the size of an RTDE message."""
SPACES = b"\t\n\r "
"""With which text may begin besides; what else does not is a browser's as well (TLS)."""
WORDS = ("GET", "HEAD", "POST", "PUT", "DELETE", "CONNECT", "OPTIONS", "TRACE", "PATCH", "PRI")
METHODS = tuple(f"{word} ".encode() for word in WORDS)
"""With which a browser begins."""
REQUEST = re.compile(rb" HTTP/\d")
"""In its first line, whatever the method."""


class Client:
    """One accepted socket, and what answers at it."""

    def __init__(
        self, sock: socket.socket, gone: Callable[["Client"], None], address: str = ""
    ) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self.sock = sock
        self.address = address
        """Of the machine at the other end."""
        self._gone = gone
        self._unsent = b""
        self._taken_at = time.monotonic()
        """When the client last took something that waited for it."""
        self._opening: bytes | None = b""
        """What came first, until it is clear that no browser is speaking."""
        self.take: Callable[[bytes], None] = lambda data: None
        """Called with what arrives."""
        self.rtde: Connection | None = None
        self.may_lag = False
        """Whether it is kept though it reads nothing: many a client only uploads programs."""

    @property
    def waits(self) -> bool:
        """Whether something is left to be sent."""
        return bool(self._unsent)

    @property
    def is_stuck(self) -> bool:
        """Whether the client has not read for too long."""
        late = time.monotonic() - self._taken_at > NOT_READING
        return self.waits and late and not self.may_lag

    def send(self, data: bytes) -> None:
        """Send a message whole; while an earlier one is stuck, drop it: the cycle never waits."""
        if not self._unsent:
            self._unsent, self._taken_at = data, time.monotonic()
            self.flush()

    def flush(self) -> None:
        """Send what is left, as far as it goes."""
        try:
            sent = self.sock.send(self._unsent)
        except BlockingIOError:
            return
        except OSError:  # gone; what it has sent before is still to be read
            self._unsent = b""
            return
        self._unsent, self._taken_at = self._unsent[sent:], time.monotonic()

    def receive(self) -> None:
        """Take in what has arrived."""
        try:
            data = self.sock.recv(CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
        elif self._opening is None:
            self.take(data)
        else:
            self._open(self._opening + data)

    def close(self) -> None:
        """Hang up."""
        self._unsent = b""
        self.take = lambda data: None
        self.sock.close()
        self._gone(self)

    def _open(self, opening: bytes) -> None:
        """Go on only if it is no browser that speaks: any page could make it."""
        first, end, _ = opening.partition(b"\n")
        is_text = self.rtde is None
        fits = (opening[0] >= PRINTABLE or opening[0] in SPACES) is is_text
        if (
            not fits
            or opening.startswith(METHODS)
            or REQUEST.search(first)
            or len(first) > LONGEST_LINE
        ):
            self.close()
        elif is_text and not end:
            self._opening = opening
        else:
            self._opening = None
            self.take(opening)


def by_line(client: Client, answer: Callable[[str], str]) -> Callable[[bytes], None]:
    """Takes bytes, and answers every whole line with another; a line that is too long ends the
    connection.
    """
    rest = b""

    def take(data: bytes) -> None:
        nonlocal rest
        *lines, rest = (rest + data).split(b"\n")
        if max(map(len, [*lines, rest])) > LONGEST_LINE:
            client.close()
            return
        replies = [answer(line.decode("utf-8", "replace")) for line in lines]
        if any(replies):
            client.send("".join(f"{reply}\n" for reply in replies if reply).encode())

    return take
