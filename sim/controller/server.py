"""The simulated controller on the network: one thread, one cycle every 2 ms on a fixed schedule.

In lockstep a cycle waits for the client as well whose targets the program streams: nobody is late.
"""

import gc
import select
import socket
import time
from collections.abc import Callable, Iterable

from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import DASHBOARD_PORT, PERIOD, RTDE_PORT
from sim.controller import primary, realtime, robot_state
from sim.controller.clients import Client, by_line
from sim.controller.controller import Controller
from sim.controller.dashboard import GREETING, Dashboard
from sim.controller.fault_injection import CONTROL_PORT, FaultInjector
from sim.controller.messages import Code, Message, ProgramError, SafetyChange
from sim.controller.outputs import Outputs
from sim.controller.realtime import Realtime
from sim.controller.robot_state import RobotState
from sim.controller.rtde import EXCEPTION, FREQUENCY, OLD_FREQUENCY, Connection, Registry
from sim.controller.urscript.splitter import Splitter
from sim.controller.urscript.values import ScriptError

SCRIPT_PORTS = (30001, 30002, 30003)
"""A controller's, as clients have them built in; each tells its state as well."""
READ_ONLY_PORTS = (30011, 30012, 30013)
"""The same, but for programs."""
READ_ONLY = Code(
    210, 0, "Socket is read-only when robot is in local (Teach pendant) control", stops=False
)
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


class Stream:
    """A package that some ports send again and again, the same to all."""

    def __init__(
        self, ports: tuple[int, ...], rate: float, controller: Controller, pack: Callable[[], bytes]
    ) -> None:
        """At a rate [Hz]."""
        self.ports = ports
        self._every = round(FREQUENCY / rate)
        self._controller, self._pack = controller, pack
        self._period, self._package = -1, b""

    @property
    def due(self) -> bool:
        """Whether one is sent in this period; at once where the safety mode has changed, so that
        no message is ahead of the state (assumed).
        """
        changed = any(isinstance(m, SafetyChange) for m in self._controller.messages)
        return changed or self._controller.periods % self._every == 0

    def send(self, client: Client) -> None:
        """Send this period's."""
        if self._period != self._controller.periods:
            self._period, self._package = self._controller.periods, self._pack()
        client.send(self._package)


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
        self._dashboard = Dashboard(controller)
        self._state = RobotState(controller, self._outputs)
        real_time = FREQUENCY if controller.config.e_series else OLD_FREQUENCY
        pack = Realtime(controller, self._outputs).package
        self._streams = (
            Stream(robot_state.PORTS, robot_state.RATE, controller, self._state.package),
            Stream(realtime.PORTS, real_time, controller, pack),
        )
        self._on_connect: dict[int, Callable[[Client], None]] = {
            RTDE_PORT: self._on_rtde,
            CONTROL_PORT: self._on_control,
            **dict.fromkeys(SCRIPT_PORTS, self._on_script),
            **dict.fromkeys(READ_ONLY_PORTS, self._on_reader),
        }
        """What is done with a new client, by port."""
        if controller.config.numbers[0] <= LAST_DASHBOARD:
            self._on_connect[DASHBOARD_PORT] = self._on_dashboard
        self._at: dict[int, list[Client]] = {port: [] for port in self._on_connect}
        """Clients, by port."""
        host = controller.config.host
        self._port_of = {self._listen(host, port): port for port in self._on_connect}
        """Of each listening socket."""
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
        """Take in what has arrived, one period of the controller, and send what is due.

        In real time a state is told when its period is over, as a robot tells it: its client then
        has a whole period for the answer, however long the next one takes here. In lockstep, where
        the answer is waited for, it is told at once.
        """
        self._exchange(0.0)
        connections = [client.rtde for client in self._client_of.values()]
        self._faults.count(sum(one.commands for one in connections if one is not None))
        if self.controller.config.clock == "real-time":
            self._tell()
        self._dashboard.cycle()
        self.controller.cycle()
        if self.controller.config.clock == "lockstep":
            self._tell()

    def _tell(self) -> None:
        """Send every client what is due."""
        for client in list(self._client_of.values()):
            self._guarded(client, self._publish)
            if client.is_stuck:
                client.close()
        for stream in self._streams:
            if stream.due and not self._faults.silent:
                for client in self._clients(*stream.ports):
                    self._guarded(client, stream.send)
        while self.controller.messages:
            self._announce(self.controller.messages.popleft())

    def _publish(self, client: Client) -> None:
        if client.rtde is None:
            return
        client.rtde.commands = 0
        client.rtde.publish(told=not self._faults.silent)

    def close(self) -> None:
        """Hang up on everyone, and free the ports."""
        for client in [*self._client_of.values()]:
            client.close()
        for listener in self._port_of:
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
            [*self._port_of, *self._client_of, *awaited], waiting, [], longest
        )
        for sock in writable:
            self._guarded(self._client_of[sock], Client.flush)
        self._turn += 1  # who comes last in one round comes earlier in another
        first = self._turn % (len(readable) or 1)
        for sock in [*readable[first:], *readable[:first]]:
            if sock in self._port_of:
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
        port = self._port_of[listener]
        clients = self._at[port]
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
        self._guarded(client, self._on_connect[port])

    def _forget(self, client: Client) -> None:
        self._client_of.pop(client.sock, None)
        for clients in self._at.values():
            if client in clients:
                clients.remove(client)
        if client.rtde is not None:
            client.rtde.closed()

    def _clients(self, *ports: int) -> list[Client]:
        """At these ports."""
        return [client for port in ports for client in self._at.get(port, ())]

    def _hang_up(self) -> None:
        """On everyone but those at the control port."""
        for client in self._clients(*(port for port in self._at if port != CONTROL_PORT)):
            client.close()

    def _announce(self, message: Message) -> None:
        """Tell the clients, where a controller tells such a thing."""
        package = primary.package(self.controller.time, message)
        for client in self._clients(*primary.PORTS):
            client.send(package)
        for client in self._clients(RTDE_PORT):
            if client.rtde is not None and isinstance(message, ProgramError):
                client.rtde.tell(f"line {message.line}: {message.text}", EXCEPTION)

    def _on_rtde(self, client: Client) -> None:
        client.rtde = Connection(client, self.controller, self._outputs, self._registry)
        client.take = client.rtde.receive

    def _on_reader(self, client: Client) -> None:
        client.may_lag = True
        if client in self._clients(*robot_state.PORTS):
            client.send(self._state.greeting())

    def _on_script(self, client: Client) -> None:
        self._on_reader(client)
        splitter, address = Splitter(), client.address

        def take(data: bytes) -> None:
            try:
                programs = splitter.feed(data)
            except ScriptError as error:
                self._announce(ProgramError(str(error), error.line))
                client.close()
                return
            if programs and not self.controller.hears_the_network:
                self._announce(READ_ONLY)
                return
            for program in programs:
                self.controller.run(program, client, address)

        client.take = take

    def _on_dashboard(self, client: Client) -> None:
        client.take = by_line(client, lambda line: self._order(client, line))
        client.send(f"{GREETING}\n".encode())

    def _order(self, client: Client, line: str) -> str:
        if line.strip().lower() == "quit":
            client.send(b"Disconnected\n")
            client.close()
            return ""
        return self._dashboard.answer(line, client.address)

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
