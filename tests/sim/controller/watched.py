"""`breastscan`, with everything written down that the twin does outside of itself while it serves.

`python -m tests.sim.controller.watched LOG twin ...`. Python's audit events tell: files, processes,
imports, sockets that it opens, code that it compiles or runs.
"""

import os
import sys

OUTSIDE = (
    "open",
    "os.",
    "shutil.",
    "subprocess.",
    "pty.",
    "exec",
    "compile",
    "import",
    "socket.connect",
    "socket.bind",
    "socket.getaddrinfo",
    "ctypes.",
    "code.",
    "marshal.",
    "pickle.",
    "tempfile.",
    "urllib.",
    "webbrowser.",
    "glob.",
    "builtins.",
    "cpython.",
    "function.",
    "sys.setprofile",
    "sys.settrace",
    "mmap.",
)
"""Beginnings of the events' names."""


def main(log: str) -> None:
    """Serve as the command line asks for."""
    from breastscan.cli import main as breastscan
    from sim.controller.server import Server

    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    watching = False
    serve, close = Server.serve, Server.close

    def note(event: str, arguments: tuple) -> None:
        if watching and event.startswith(OUTSIDE):
            os.write(out, f"{event} {str(arguments)[:200]!r}\n".encode())

    def watched_serve(server, ended):
        nonlocal watching
        watching = True
        serve(server, ended)

    def watched_close(server):
        nonlocal watching
        watching = False
        close(server)

    Server.serve, Server.close = watched_serve, watched_close
    sys.addaudithook(note)
    breastscan()


if __name__ == "__main__":
    main(sys.argv.pop(1))
