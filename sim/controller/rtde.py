"""The controller's side of RTDE, the real-time data exchange: port 30004, binary, big-endian."""

import math
import struct
from collections.abc import Callable
from typing import Protocol

from breastscan.robot.ur.ur5e import PERIOD
from sim.controller.controller import Controller
from sim.controller.outputs import Outputs
from sim.controller.variables import INPUTS, Held, Recipe, offered

VERSION, CONTROLLER, OUTPUT_SETUP, INPUT_SETUP, START, PAUSE, DATA, TEXT = b"VvOISPUM"
"""Types of messages."""
HEADER = struct.Struct(">HB")
PROTOCOLS = (1, 2)
"""Versions that are spoken; data packages carry a recipe's number in the second only."""
FREQUENCY = 1 / PERIOD
"""Highest rate of output [Hz]."""
OLD_FREQUENCY = 125.0
"""Rate in the protocol's first version, and the highest of a controller older than the e-Series
[Hz]."""
EXCEPTION, ERROR = 0, 1
"""Levels of a text message."""
MAX_RECIPES, MAX_FIELDS = 255, 400
"""Of inputs, and fields of a recipe, for each connection: a little more than there are
variables."""
MAY_BE_NOISE = frozenset({"standard_analog_output_0", "standard_analog_output_1"})
"""Fields that a client in use leaves as it found its memory, where the mask says that they do not
count."""


class Registry:
    """Which connection holds which input: one at a time."""

    def __init__(self) -> None:
        self._holders: dict[str, Connection] = {}

    def free_for(self, name: str, connection: "Connection") -> bool:
        """Whether a connection may write an input."""
        return self._holders.get(name, connection) is connection

    def take(self, names: list[str], connection: "Connection") -> None:
        """Hold inputs."""
        self._holders.update(dict.fromkeys(names, connection))

    def release(self, connection: "Connection") -> None:
        """Free what a connection held; the values stay."""
        self._holders = {
            name: holder for name, holder in self._holders.items() if holder is not connection
        }


class Line(Protocol):
    """Where answers go."""

    def send(self, data: bytes) -> None:
        """Send a message whole, or not at all."""
        ...

    def close(self) -> None:
        """Hang up."""
        ...


class Connection:
    """One client."""

    def __init__(
        self, line: Line, controller: Controller, outputs: Outputs, registry: Registry
    ) -> None:
        self._line = line
        self._controller = controller
        self._outputs = outputs
        self._registry = registry
        self._arrived = b""
        self._offered = offered(controller.config.numbers)
        self._highest = FREQUENCY if controller.config.e_series else OLD_FREQUENCY
        self._version = 1
        self._recipe: Recipe | None = None
        self._read = outputs.reader([])
        self._inputs: list[Recipe] = []
        self._started = False
        self._is_client = False
        """Whether it has sent a message that there is: what begins otherwise speaks another
        language."""
        self._per_cycle, self._due = 1.0, 0.0
        self.commands = 0
        """Data packages that came in since the last period."""
        self.answered = True
        """Whether a package has come since the last state, or the program heeds none from here."""
        self._held: set[str] = set()
        """Inputs that are written from here."""

    def receive(self, data: bytes) -> None:
        """Take in bytes, and answer every message that is complete."""
        self._arrived += data
        while len(self._arrived) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._arrived)
            if size < HEADER.size:
                self._line.close()
                return
            if len(self._arrived) < size:
                return
            payload, self._arrived = self._arrived[HEADER.size : size], self._arrived[size:]
            self._answer(kind, payload)

    def publish(self, told: bool = True) -> None:
        """Send a data package, where one is due in this period; untold it is lost on the way."""
        if not self._started or self._recipe is None:
            return
        self._due += self._per_cycle
        if self._due < 1.0 - 1e-9:
            return
        self._due -= 1.0
        number = b"\x01" if self._version == 2 else b""
        if told:
            self._reply(DATA, number + self._recipe.pack(self._read()))
        self.answered = self._held.isdisjoint(self._controller.heeded)

    def closed(self) -> None:
        """The client is gone."""
        self._registry.release(self)

    def tell(self, text: str, level: int) -> None:
        """Tell a client that has started; before that it reads one answer for each question."""
        if self._started:
            words = [word.encode()[:255] for word in (text, "RTDE")]
            self._reply(
                TEXT,
                b"".join(struct.pack(">B", len(word)) + word for word in words) + bytes([level]),
            )

    def _answer(self, kind: int, payload: bytes) -> None:
        if kind not in _MESSAGES and not self._is_client:
            self._line.close()
            return
        self._is_client = True
        try:
            _MESSAGES[kind](self, payload)
        except (struct.error, UnicodeDecodeError, LookupError):
            self.tell(f"message {chr(kind)} of {len(payload)} bytes is not understood", ERROR)

    def _tell_version(self, payload: bytes) -> None:
        self._reply(CONTROLLER, struct.pack(">4I", *self._controller.config.numbers))

    def _start(self, payload: bytes) -> None:
        self._started = self._recipe is not None
        self._reply(START, struct.pack(">B", self._started))

    def _pause(self, payload: bytes) -> None:
        self._started, self.answered = False, True
        self._reply(PAUSE, b"\x01")

    def _agree(self, payload: bytes) -> None:
        (version,) = struct.unpack(">H", payload)
        self._version = version if version in PROTOCOLS else self._version
        self._reply(VERSION, struct.pack(">B", version in PROTOCOLS))

    def _set_up_outputs(self, payload: bytes) -> None:
        frequency = OLD_FREQUENCY
        if self._version == 2:
            (frequency,) = struct.unpack_from(">d", payload)
            payload = payload[8:]
        names = _names(payload)
        kinds = [self._offered.get(name, "NOT_FOUND") for name in names]
        known = "NOT_FOUND" not in kinds and len(names) <= MAX_FIELDS and math.isfinite(frequency)
        if known:
            self._recipe, self._read = Recipe(names, kinds), self._outputs.reader(names)
            self._per_cycle, self._due = min(max(frequency, 1.0), self._highest) / FREQUENCY, 0.0
        number = struct.pack(">B", known) if self._version == 2 else b""
        self._reply(OUTPUT_SETUP, number + ",".join(kinds).encode())

    def _set_up_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        kinds = [
            INPUTS.get(name, "NOT_FOUND") if self._registry.free_for(name, self) else "IN_USE"
            for name in names
        ]
        number = 0
        fits = len(names) <= MAX_FIELDS and len(self._inputs) < MAX_RECIPES
        if fits and not {"NOT_FOUND", "IN_USE"} & set(kinds):
            self._registry.take(names, self)
            self._held.update(names)
            self._inputs.append(Recipe(names, kinds))
            number = len(self._inputs)
        self._reply(INPUT_SETUP, struct.pack(">B", number) + ",".join(kinds).encode())

    def _take(self, payload: bytes) -> None:
        """A data package; it may be longer than its recipe, which a client in use gets wrong."""
        number = payload[0]
        if not 1 <= number <= len(self._inputs) or len(payload) - 1 < self._inputs[number - 1].size:
            self.tell(f"there is no recipe {number} of {len(payload) - 1} bytes", ERROR)
            return
        values = self._inputs[number - 1].unpack(payload[1:])
        for name in [name for name, value in values.items() if not _is_finite(value)]:
            if name not in MAY_BE_NOISE:
                self.tell(f"{name} must be finite: the package is refused", ERROR)
                return
            del values[name]
        self.commands += 1
        self.answered = True
        self._controller.write(values)

    def _note(self, payload: bytes) -> None:
        """A client's words for the operator."""
        length = payload[0]
        self._controller.tell(payload[1 : 1 + length].decode("utf-8", "replace"))

    def _reply(self, kind: int, payload: bytes) -> None:
        self._line.send(HEADER.pack(HEADER.size + len(payload), kind) + payload)


def _names(payload: bytes) -> list[str]:
    """Names between commas; a client in use ends the list with one."""
    names = [name.strip() for name in payload.decode("ascii").split(",")]
    names = names[:-1] if names and not names[-1] else names
    return names[: MAX_FIELDS + 1]


def _is_finite(value: Held) -> bool:
    return all(map(math.isfinite, value)) if isinstance(value, list) else math.isfinite(value)


_MESSAGES: dict[int, Callable[[Connection, bytes], None]] = {
    VERSION: Connection._agree,
    CONTROLLER: Connection._tell_version,
    OUTPUT_SETUP: Connection._set_up_outputs,
    INPUT_SETUP: Connection._set_up_inputs,
    START: Connection._start,
    PAUSE: Connection._pause,
    DATA: Connection._take,
    TEXT: Connection._note,
}
"""What each type of message makes a connection do."""
