"""The connections that a program opens: to the machine that it came from, and to no other.

Nothing here waits: who reads asks every period whether enough has come.
"""

import ipaddress
import select
import socket
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import TypeVar

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.urscript.values import ScriptError, shown

MAX_SOCKETS = 16
"""Of a program at once."""
LONGEST_MESSAGE = 1023
"""Characters of a string that is read [UR-script, `socket_read_string`]."""
KEPT = 4096
"""Bytes that have come and are not read yet; more stays with the system, and so with the peer."""
REFUSED = (OSError, OverflowError)
Read = TypeVar("Read")


@dataclass
class Connection:
    """One socket, and what has come at it."""

    sock: socket.socket
    come: bytearray = field(default_factory=bytearray)
    ended: bool = False
    """Whether the peer has hung up, or does not read."""

    def receive(self) -> None:
        """Take in what has arrived."""
        while not self.ended and len(self.come) < KEPT:
            try:
                data = self.sock.recv(KEPT - len(self.come))
            except BlockingIOError:
                return
            except OSError:
                data = b""
            self.come += data
            self.ended = not data

    def take(self, count: int) -> bytes:
        """The first bytes, once and for all."""
        taken = bytes(self.come[:count])
        del self.come[:count]
        return taken


class Sockets:
    """Those of the running program, by name."""

    def __init__(self) -> None:
        self._open: dict[str, Connection] = {}
        self.awaited: dict[str, socket.socket] = {}
        """At which a program waits for so long at most: the next command comes there."""

    def begin(self, name: str, address: str, port: int, sender: str) -> Connection:
        """Start to connect.

        Args:
            name: Of the socket; an open one of this name is closed.
            address: In numbers, or localhost.
            port: Of the server.
            sender: Address of the machine that the program came from.

        Raises:
            ScriptError: The address is another machine's, or there are too many.
        """
        host = _permitted(address, sender)
        self.close(name)
        if len(self._open) >= MAX_SOCKETS:
            raise ScriptError(f"a program has {MAX_SOCKETS} sockets at most")
        sock = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = self._open[name] = Connection(sock)
        try:
            sock.connect_ex((host, port))
        except REFUSED:
            connection.ended = True
        return connection

    def opened(
        self, name: str, address: str, port: int, sender: str, seconds: float
    ) -> Generator[None, None, Connection | None]:
        """Connect, for so long at most [s], a look a period; None where nobody takes it.

        Raises:
            ScriptError: As `begin`.
        """
        connection, is_connected = self.begin(name, address, port, sender), None
        for _ in range(round(seconds / PERIOD)):
            yield
            is_connected = self._is_connected(connection)
            if is_connected is not None:
                break
        if is_connected:
            return connection
        self.close(name)
        return None

    @staticmethod
    def _is_connected(connection: Connection) -> bool | None:
        """None while that is open."""
        if connection.ended:
            return False
        _, writable, _ = select.select([], [connection.sock], [], 0.0)
        if not writable:
            return None
        return connection.sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0

    def close(self, name: str) -> None:
        """Hang up, where it is open."""
        self.awaited.pop(name, None)
        connection = self._open.pop(name, None)
        if connection is not None:
            connection.sock.close()

    def close_all(self) -> None:
        """Hang up everywhere."""
        for name in list(self._open):
            self.close(name)

    def send(self, name: str, data: bytes) -> bool:
        """Send a message whole, or hang up: a peer that does not read is left."""
        connection = self._open.get(name)
        if connection is None or connection.ended:
            return False
        try:
            sent = connection.sock.send(data)
        except OSError:
            sent = -1
        connection.ended = sent != len(data)
        return not connection.ended

    def read(self, name: str, take: Callable[[Connection], Read | None]) -> Read | None:
        """What `take` makes of what has come; None while that is too little.

        Raises:
            ConnectionError: Nothing can come any more.
        """
        connection = self._open.get(name)
        if connection is None:
            raise ConnectionError(f"the socket {shown(name)} is not open")
        connection.receive()
        taken = take(connection)
        if taken is None and connection.ended:
            raise ConnectionError(f"the peer of {shown(name)} has hung up")
        return taken

    def wait(self, name: str) -> None:
        """Note that a program waits there for a time."""
        if name in self._open:
            self.awaited[name] = self._open[name].sock


def _permitted(address: str, sender: str) -> str:
    """The address, where a program may connect to it."""
    text = "127.0.0.1" if address == "localhost" else address
    try:
        wanted, own = ipaddress.ip_address(text), ipaddress.ip_address(sender)
        permitted = wanted == own or (wanted.is_loopback and own.is_loopback)
    except ValueError:
        permitted = False
    if not permitted:
        raise ScriptError(
            "socket_open and rpc_factory connect to the machine that sent the program "
            f"({sender}), by its address in numbers, and to no other, got {shown(address)}",
            address,
        )
    return text
