"""The simulated controller on the network: one thread, one cycle every 2 ms on a fixed schedule.

In lockstep a cycle waits for the client as well whose targets the program streams: nobody is late.
"""

import gc
import os
import select
import socket
import time
from collections.abc import Callable, Iterable

from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import DASHBOARD_PORT, PERIOD, RTDE_PORT
from sim.controller import dashboard, primary
from sim.controller.clients import Client, by_line
from sim.controller.controller import Controller
from sim.controller.fault_injection import CONTROL_PORT, FaultInjector
from sim.controller.messages import Message, ProgramError
from sim.controller.outputs import Outputs
from sim.controller.rtde import EXCEPTION, Connection, Registry
from sim.controller.urscript.splitter import Splitter
from sim.controller.urscript.values import ScriptError

SCRIPT_PORTS = (30001, 30002, 30003)
"""A controller's; clients have them built in."""
LAST_DASHBOARD = 9
"""Last major version with a dashboard."""
TOO_LATE = 0.05
"""A cycle that is later than this is not caught up with [s]."""
PATIENCE = 2.0
"""Longest that a cycle waits in lockstep for an answer [s]; then time goes on until one comes."""
LONGEST_WAIT = 0.1
"""Between two checks whether the end has come [s]."""
MAX_CLIENTS = 32
"""At each port; who comes beyond is hung up on."""
PRIORITY = 20
"""Of real-time scheduling, where the system grants it."""


class Server:
    """Listens at a controller's ports and steps the controller."""

    def __init__(self, controller: Controller) -> None:
        """Open the ports.

        Raises:
            RobotError: One of them is in use.
        """
        self.controller = controller
        self._outputs, self._registry = Outputs(controller), Registry()
        self._faults = FaultInjector(controller, self._outputs, self._hang_up)
        host = controller.config.host
        ports = {RTDE_PORT: self._on_rtde, CONTROL_PORT: self._on_control}
        ports |= dict.fromkeys(SCRIPT_PORTS, self._on_script)
        if controller.config.numbers[0] <= LAST_DASHBOARD:
            ports[DASHBOARD_PORT] = self._on_dashboard
        self._on_connect: dict[socket.socket, Callable[[Client], None]] = {}
        """What is done with a new client, by listening socket."""
        self._at: dict[socket.socket, list[Client]] = {}
        """Clients, by the socket that accepted them."""
        for port, on_connect in ports.items():
            listener = self._listen(host, port)
            self._on_connect[listener], self._at[listener] = on_connect, []
        self._client_of: dict[socket.socket, Client] = {}
        self._turn = 0
        self._patience = PATIENCE

    def serve(self, ended: Callable[[], bool]) -> None:
        """Run until `ended`, then close the ports."""
        gc.collect()
        # what is here stays; the collector need not look at it in the middle of a cycle
        gc.freeze()
        due = time.monotonic() + PERIOD
        try:
            while not ended():
                self._wait(due, ended)
                self.step()
                due += PERIOD
                if time.monotonic() > due + TOO_LATE:
                    due = time.monotonic() + PERIOD
        finally:
            self.close()

    def step(self) -> None:
        """Take in what has arrived, one period of the controller, and send what is due."""
        self._exchange(0.0)
        clients = list(self._client_of.values())
        self._faults.count(
            sum(client.rtde.commands for client in clients if client.rtde is not None)
        )
        self.controller.cycle()
        while self.controller.messages:
            self._announce(self.controller.messages.popleft())
        for client in clients:
            self._guarded(client, self._publish)
            if client.is_stuck:
                client.close()

    def _publish(self, client: Client) -> None:
        if client.rtde is None:
            return
        client.rtde.commands = 0
        client.rtde.publish(told=not self._faults.silent)

    def close(self) -> None:
        """Hang up on everyone, and free the ports."""
        for client in [*self._client_of.values()]:
            client.close()
        for listener in self._on_connect:
            listener.close()

    def _wait(self, due: float, ended: Callable[[], bool]) -> None:
        """Answer whoever asks until a cycle is due [s], in lockstep until its client answers."""
        until = due + self._patience
        while (left := (until if self._unanswered else due) - time.monotonic()) > 0 and not ended():
            awaited = self.controller.sockets.awaited.values() if self._unanswered else ()
            self._exchange(min(left, LONGEST_WAIT), awaited)
        self._patience = 0.0 if self._unanswered else PATIENCE

    @property
    def _unanswered(self) -> bool:
        """Whether the next target is still to come, in lockstep."""
        controller = self.controller
        if controller.config.clock != "lockstep" or not controller.streams:
            return False
        if controller.sockets.awaited:
            return not select.select([*controller.sockets.awaited.values()], [], [], 0.0)[0]
        connections = [client.rtde for client in self._client_of.values()]
        return not all(connection is None or connection.answered for connection in connections)

    def _exchange(self, longest: float, awaited: Iterable[socket.socket] = ()) -> None:
        """Wait for sockets so long [s] at most, those that the program reads among them, and serve
        the clients' that are ready, but no longer than a cycle may wait.
        """
        end = time.monotonic() + max(longest, PERIOD)
        waiting = [sock for sock, client in self._client_of.items() if client.waits]
        readable, writable, _ = select.select(
            [*self._on_connect, *self._client_of, *awaited], waiting, [], longest
        )
        for sock in writable:
            self._guarded(self._client_of[sock], Client.flush)
        self._turn += 1  # who comes last in one round comes earlier in another
        first = self._turn % (len(readable) or 1)
        for sock in [*readable[first:], *readable[:first]]:
            if sock in self._on_connect:
                self._accept(sock)
            elif sock in self._client_of:  # not hung up on in this round
                self._guarded(self._client_of[sock], Client.receive)
            if time.monotonic() > end:
                return

    def _guarded(self, client: Client, act: Callable[[Client], None]) -> None:
        """Serve a client; whatever it brings about that nobody has thought of ends its
        connection, and no other.
        """
        try:
            act(client)
        except Exception as error:  # the border: behind it errors are caught by name
            self.controller.tell(f"a client was dropped: {error!r}")
            client.close()

    def _accept(self, listener: socket.socket) -> None:
        """Take on a new client, unless there are too many."""
        try:
            sock, peer = listener.accept()
        except OSError:  # gone already
            return
        clients = self._at[listener]
        if len(clients) >= MAX_CLIENTS:
            sock.close()
            return
        try:
            client = Client(sock, self._forget, peer[0])
        except OSError:
            sock.close()
            return
        clients.append(client)
        self._client_of[sock] = client
        self._on_connect[listener](client)

    def _forget(self, client: Client) -> None:
        self._client_of.pop(client.sock, None)
        for clients in self._at.values():
            if client in clients:
                clients.remove(client)
        if client.rtde is not None:
            client.rtde.closed()

    def _clients(self, *ports: int) -> list[Client]:
        """At these ports; all if none are named."""
        return [
            client
            for listener, clients in self._at.items()
            for client in clients
            if not ports or listener.getsockname()[1] in ports
        ]

    def _hang_up(self) -> None:
        """On everyone but those at the control port."""
        for client in self._clients(RTDE_PORT, DASHBOARD_PORT, *SCRIPT_PORTS):
            client.close()

    def _announce(self, message: Message) -> None:
        """Tell the clients, where a controller tells such a thing."""
        package = primary.package(self.controller.time, message)
        for client in self._clients(*primary.PORTS) if package else ():
            client.send(package)
        for client in self._clients(RTDE_PORT):
            if client.rtde is not None and isinstance(message, ProgramError):
                client.rtde.tell(f"line {message.line}: {message.text}", EXCEPTION)

    def _on_rtde(self, client: Client) -> None:
        client.rtde = Connection(client, self.controller, self._outputs, self._registry)
        client.take = client.rtde.receive

    def _on_script(self, client: Client) -> None:
        splitter, address = Splitter(), client.address

        def take(data: bytes) -> None:
            try:
                programs = splitter.feed(data)
            except ScriptError as error:
                self._announce(ProgramError(str(error), error.line))
                client.close()
                return
            for program in programs:
                self.controller.run(program, client, address)

        client.take = take

    def _on_dashboard(self, client: Client) -> None:
        client.take = by_line(client, lambda line: self._dashboard(client, line))
        client.send(f"{dashboard.GREETING}\n".encode())

    def _dashboard(self, client: Client, line: str) -> str:
        if line.strip().lower() == "quit":
            client.send(b"Disconnected\n")
            client.close()
            return ""
        return dashboard.answer(line, self.controller)

    def _on_control(self, client: Client) -> None:
        client.take = by_line(client, self._faults.answer)

    @staticmethod
    def _listen(host: str, port: int) -> socket.socket:
        listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
        except OSError as error:
            raise RobotError(
                f"port {port} of {host} cannot be opened ({error.strerror}): if another twin runs "
                "there, end it, or take another loopback address (--controller.host 127.0.0.2)",
                port,
            ) from error
        listener.listen()
        listener.setblocking(False)
        return listener


def ask_for_priority() -> bool:
    """Real-time scheduling for this process; whether the system grants it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (AttributeError, PermissionError, OSError):
        return False
    return True
