"""Functions of a server that a program calls: XML-RPC over HTTP, a connection for each call
[UR-script, "Remote Procedure Call (RPC)"].

A pose is the struct of x, y, z, rx, ry and rz that servers for these robots take and give.
"""

import re
from collections.abc import Generator, Iterable, Sequence
from itertools import count
from typing import Any
from xmlrpc.client import Fault, dumps, loads

from sim.controller.controller import Controller
from sim.controller.socket_functions import Take, connected
from sim.controller.sockets import Connection
from sim.controller.urscript.signature import (
    INTEGER,
    REFUSED,
    TEXT,
    Function,
    Parameter,
    choice,
    row,
)
from sim.controller.urscript.values import (
    Pose,
    Remote,
    ScriptError,
    Struct,
    Value,
    is_number,
    make_list,
    make_pose,
    make_string,
    make_struct,
    shown,
)

URL = re.compile(r"http://([^/:]+)(?::(\d{1,5}))?(/[!-~]*)?")
LENGTH = re.compile(rb"\r\ncontent-length: *(\d{1,9})\r\n", re.IGNORECASE)
LONGEST_ANSWER = 32_768
"""Bytes."""
COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
CLOSE = "closeXMLRPCClientConnection"


def rpc_functions(controller: Controller) -> Iterable[Function]:
    """The row of the function that makes a handle."""
    sockets, numbers = controller.sockets, count()

    def create(kind: str, url: str) -> Generator[None, None, Remote]:
        parts = URL.fullmatch(url)
        if parts is None:
            raise ScriptError(
                f"rpc_factory: url is http://address:port/path, got {shown(url)}", url
            )
        address, port = parts[1], int(parts[2] or 80)
        path = parts[3] or "/"

        def exchange(request: bytes) -> Generator[None, None, bytes]:
            """What the server answers; of no request, whether it is there."""
            name = f"{url} {next(numbers)}"
            try:
                if not (yield from connected(controller, address, port, name)):
                    raise ScriptError(f"rpc_factory: no server answers at {shown(url)}", url)
                if not request:
                    return b""
                take = _whole(bytearray())
                sockets.send(name, request)
                while (answer := sockets.read(name, take)) is None:
                    yield
                return answer
            except ConnectionError as error:
                raise ScriptError(f"{shown(url)} gives no answer: {error}", url) from error
            finally:
                sockets.close(name)

        def call(method: str, arguments: Sequence[Value]) -> Generator[None, None, Value]:
            if method == CLOSE:
                return None
            what = f"{method} at {shown(url)}"
            body = dumps(tuple(_sent(value, what) for value in arguments), method).encode()
            head = f"POST {path} HTTP/1.1\r\nHost: {address}:{port}\r\nContent-Type: text/xml\r\n"
            head += f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
            answer = yield from exchange(head.encode() + body)
            try:
                if b"<!" in answer:
                    raise ValueError("declarations are not taken")
                (value,), _ = loads(answer.decode())
                return _taken(value)
            except Fault as fault:
                raise ScriptError(f"{what}: {shown(fault.faultString, 200)}", fault) from fault
            # the parser raises whatever a wrong answer brings about
            except Exception as error:
                raise ScriptError(f"{what}: not an answer to take: {error}", error) from error

        yield from exchange(b"")
        return Remote(url, call)

    kind, url = Parameter("type", choice("xmlrpc")), Parameter("url", TEXT)
    yield row("rpc_factory", create, kind, url, waits=True)


def _whole(answer: bytearray) -> Take:
    """Takes the body of an answer, once it is there."""

    def take(connection: Connection) -> bytes | None:
        answer.extend(connection.take(len(connection.come)))
        if len(answer) > LONGEST_ANSWER:
            raise ScriptError(f"an answer has {LONGEST_ANSWER} bytes at most")
        head, _, body = bytes(answer).partition(b"\r\n\r\n")
        length = LENGTH.search(head + b"\r\n")
        return body if length and len(body) >= int(length[1]) else None

    return take


def _sent(value: Value, what: str) -> Any:
    """A value as XML-RPC has it."""
    if isinstance(value, Pose):
        return dict(zip(COORDINATES, value, strict=True))
    if isinstance(value, tuple):
        return [_sent(part, what) for part in value]
    if isinstance(value, Struct):
        return {name: _sent(member, what) for name, member in value.members.items()}
    if not isinstance(value, bool | str) and not is_number(value):
        raise ScriptError(f"{what} takes no {shown(value)}", value)
    return value


def _taken(value: Any) -> Value:
    """The reverse."""
    if isinstance(value, dict) and value.keys() == set(COORDINATES):
        return make_pose(_taken(value[name]) for name in COORDINATES)
    if isinstance(value, dict):
        return make_struct((name, _taken(member)) for name, member in value.items())
    if isinstance(value, list):
        return make_list(map(_taken, value))
    if isinstance(value, str):
        return make_string((value,))
    if not isinstance(value, bool | float | None) and INTEGER.take(value) is REFUSED:
        raise ValueError(f"{shown(str(value))} is no value of a program")
    return value
