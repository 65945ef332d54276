"""The simulated controller on the network, in real time: one thread, one cycle every 2 ms on an absolute schedule."""

import gc
import os
import select
import socket
import time
from collections.abc import Callable

from breastscan.errors import RobotError
from sim.controller import dashboard
from sim.controller.controller import Controller
from sim.controller.faults import CONTROL_PORT, Faults
from sim.controller.outputs import Outputs
from sim.controller.rtde import Connection, Registry
from sim.controller.urscript import Splitter
from sim.servo import PERIOD

RTDE_PORT, DASHBOARD_PORT, SCRIPT_PORTS = 30004, 29999, (30001, 30002, 30003)
"""A controller's; clients have them built in."""
LAST_DASHBOARD = 9
"""Last major version with a dashboard."""
TOO_LATE = 0.05
"""A cycle that is later than this is not caught up with [s]."""
CHUNK = 65536
PRIORITY = 20
"""Of real-time scheduling, where the system grants it."""


class Client:
    """One accepted socket, and what answers at it."""

    def __init__(self, sock: socket.socket, gone: Callable[["Client"], None]) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock, self._gone, self._unsent = sock, gone, b""
        self.take: Callable[[bytes], None] = lambda data: None
        """Called with what arrives."""
        self.rtde: Connection | None = None
        self.control = False
        """Whether it came to the control port."""

    @property
    def waits(self) -> bool:
        """Whether something is left to be sent."""
        return bool(self._unsent)

    def send(self, data: bytes) -> None:
        """Send a message whole; while an earlier one is stuck, drop it: the cycle never waits."""
        if not self._unsent:
            self._unsent = data
            self.flush()

    def flush(self) -> None:
        """Send what is left, as far as it goes."""
        try:
            self._unsent = self._unsent[self.sock.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()

    def receive(self) -> None:
        """Take in what has arrived."""
        try:
            data = self.sock.recv(CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.take(data)
        else:
            self.close()

    def close(self) -> None:
        """Hang up."""
        self._unsent = b""
        self.sock.close()
        self._gone(self)


class Server:
    """Listens at a controller's ports and steps the controller."""

    def __init__(self, controller: Controller) -> None:
        """Open the ports.

        Raises:
            RobotError: One of them is in use.
        """
        self.controller = controller
        self._outputs, self._registry = Outputs(controller), Registry()
        self._faults = Faults(controller, self._outputs, self._hang_up)
        self._clients: list[Client] = []
        host = controller.config.host
        greeters = {RTDE_PORT: self._greet_rtde, CONTROL_PORT: self._greet_control}
        greeters |= dict.fromkeys(SCRIPT_PORTS, self._greet_script)
        if controller.config.numbers[0] <= LAST_DASHBOARD:
            greeters[DASHBOARD_PORT] = self._greet_dashboard
        self._listeners: dict[socket.socket, Callable[[Client], None]] = {}
        for port, greet in greeters.items():
            self._listeners[self._listen(host, port)] = greet

    def serve(self, ended: Callable[[], bool]) -> None:
        """Run in real time until `ended`, then close the ports."""
        gc.collect()
        gc.freeze()  # what is here stays; the collector need not look at it in the middle of a cycle
        due = time.monotonic() + PERIOD
        try:
            while not ended():
                self._wait(due)
                self.step()
                due += PERIOD
                if time.monotonic() > due + TOO_LATE:
                    due = time.monotonic() + PERIOD
        finally:
            self.close()

    def step(self) -> None:
        """Take in what has arrived, one period of the controller, and send what is due."""
        self._exchange(0.0)
        connections = [client.rtde for client in self._clients if client.rtde is not None]
        self._faults.count(sum(connection.commands for connection in connections))
        self.controller.cycle()
        for connection in connections:
            connection.commands = 0
            if not self._faults.silent:
                connection.publish()

    def close(self) -> None:
        """Hang up on everyone, and free the ports."""
        for client in [*self._clients]:
            client.close()
        for listener in self._listeners:
            listener.close()

    def _wait(self, due: float) -> None:
        """Answer whoever asks until the next cycle is due [s]."""
        while True:
            left = due - time.monotonic()
            if left <= 0:
                return
            self._exchange(left)

    def _exchange(self, longest: float) -> None:
        """Wait for sockets, and serve those that are ready."""
        waiting = [client.sock for client in self._clients if client.waits]
        by_socket = {client.sock: client for client in self._clients}
        readable, writable, _ = select.select([*self._listeners, *by_socket], waiting, [], longest)
        for sock in writable:
            by_socket[sock].flush()
        for sock in readable:
            if sock in self._listeners:
                self._accept(sock)
            elif sock.fileno() >= 0:  # not hung up on in this round
                by_socket[sock].receive()

    def _accept(self, listener: socket.socket) -> None:
        client = Client(listener.accept()[0], self._forget)
        self._clients.append(client)
        self._listeners[listener](client)

    def _forget(self, client: Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            if client.rtde is not None:
                client.rtde.closed()

    def _hang_up(self) -> None:
        """On everyone but those at the control port."""
        for client in [client for client in self._clients if not client.control]:
            client.close()

    def _greet_rtde(self, client: Client) -> None:
        client.rtde = Connection(client, self.controller, self._outputs, self._registry)
        client.take = client.rtde.receive

    def _greet_script(self, client: Client) -> None:
        splitter = Splitter()

        def take(data: bytes) -> None:
            for program in splitter.feed(data):
                self.controller.run(program)

        client.take = take

    def _greet_dashboard(self, client: Client) -> None:
        client.take = _by_line(client, lambda line: self._dashboard(client, line))
        client.send(f"{dashboard.GREETING}\n".encode())

    def _dashboard(self, client: Client, line: str) -> str:
        if line.strip().lower() == "quit":
            client.send(b"Disconnected\n")
            client.close()
            return ""
        return dashboard.answer(line, self.controller)

    def _greet_control(self, client: Client) -> None:
        client.control = True
        client.take = _by_line(client, self._faults.answer)

    @staticmethod
    def _listen(host: str, port: int) -> socket.socket:
        listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
        except OSError as error:
            raise RobotError(
                f"port {port} of {host} cannot be opened ({error.strerror}): if another twin runs there, end it, or "
                "take another loopback address (--controller.host 127.0.0.2)",
                port,
            ) from error
        listener.listen()
        listener.setblocking(False)
        return listener


def _by_line(client: Client, answer: Callable[[str], str]) -> Callable[[bytes], None]:
    """Takes bytes, and answers every whole line with another."""
    rest = b""

    def take(data: bytes) -> None:
        nonlocal rest
        *lines, rest = (rest + data).split(b"\n")
        replies = [answer(line.decode("utf-8", "replace")) for line in lines]
        if any(replies):
            client.send("".join(f"{reply}\n" for reply in replies if reply).encode())

    return take


def ask_for_priority() -> bool:
    """Real-time scheduling for this process; whether the system grants it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (AttributeError, PermissionError, OSError):
        return False
    return True
