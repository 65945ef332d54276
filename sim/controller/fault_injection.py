"""Fault injection: the control port of the twin, and its client.

One JSON object a line each way. It is no part of a controller's protocol.
"""

import json
import math
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from breastscan.errors import RobotError
from sim.controller.controller import Controller
from sim.controller.outputs import Outputs
from sim.controller.states import Safety
from sim.controller.urscript.values import shown

CONTROL_PORT = 30100
LONGEST_FAULT, STRONGEST_PUSH = 1e6, 1000.0
"""[s], [N]"""
ANSWER_TIME = 5.0
"""Longest wait for an answer [s]."""


class FaultInjector:
    """Injects faults, and keeps the books."""

    def __init__(
        self, controller: Controller, outputs: Outputs, hang_up: Callable[[], None]
    ) -> None:
        self._controller, self._outputs = controller, outputs
        self._silent_until = -1.0
        self._counts = [0, 0, 0]
        """Cycles with no, one, and more command packages, while a program ran."""
        self._highest_force = 0.0
        self._actions: dict[str, Callable[[], dict[str, Any] | None]] = {
            "protective_stop": lambda: controller.protective_stop("asked for at the control port"),
            "emergency_stop": controller.emergency_stop,
            "system_emergency_stop": lambda: controller.emergency_stop(
                Safety.SYSTEM_EMERGENCY_STOP
            ),
            "safeguard_stop": controller.safeguard_stop,
            "release": controller.release,
            "script_error": lambda: controller.stop_program(
                "an error, asked for at the control port"
            ),
            "close_connections": hang_up,
            "freeze_sensor": outputs.freeze_wrench,
            "reset": self._reset,
            "status": self._status,
        }
        self._with_numbers: dict[str, tuple[tuple[str, ...], Callable[..., None]]] = {
            "silence": (("seconds",), self._silence),
            "remote_control": (("on",), self._remote_control),
            "reduced": (("on",), lambda on: controller.reduce(bool(on))),
            "hold": (("joint", "seconds"), self._hold),
            "push": (("fx", "fy", "fz", "seconds"), self._push),
        }
        """Actions with arguments, and their names."""

    @property
    def silent(self) -> bool:
        """Whether nothing is published."""
        return self._controller.time < self._silent_until

    def count(self, commands: int) -> None:
        """Note the data packages of a period, and the force in the last."""
        if self._controller.program is not None:
            self._counts[min(commands, 2)] += 1
        self._highest_force = max(self._highest_force, self._force)

    def answer(self, line: str) -> str:
        """Do what a line asks for."""
        try:
            request = json.loads(line, parse_constant=_refuse, parse_int=float)
        except (ValueError, RecursionError) as error:
            return self._refusal(f"no JSON: {error}")
        if not isinstance(request, dict) or not isinstance(request.get("do"), str):
            return self._refusal('expected {"do": WORD}')
        word = request.pop("do")
        if word in self._actions and not request:
            return json.dumps({"ok": True, **(self._actions[word]() or {})})
        if word in self._with_numbers:
            names, act = self._with_numbers[word]
            if request.keys() == set(names) and all(map(_is_finite, request.values())):
                act(**request)
                return json.dumps({"ok": True})
        return self._refusal(f"{shown(word)} with {shown(tuple(request))}")

    def _refusal(self, what: str) -> str:
        known = [
            *self._actions,
            *(f"{word} ({', '.join(names)})" for word, (names, _) in self._with_numbers.items()),
        ]
        return json.dumps({"ok": False, "error": f"{what}; known: {', '.join(known)}"})

    @property
    def _force(self) -> float:
        """That the tissue exerts on the probe [N]."""
        contact = self._controller.robot.contact
        return 0.0 if contact is None else float(np.sqrt(contact.force_S @ contact.force_S))

    def _silence(self, seconds: float) -> None:
        self._silent_until = self._controller.time + seconds

    def _hold(self, joint: float, seconds: float) -> None:
        """Joints count from 1, as in `joint1`."""
        i = min(max(round(joint), 1), 6) - 1
        self._controller.robot.hold(i, min(max(seconds, 0.0), LONGEST_FAULT))

    def _push(self, fx: float, fy: float, fz: float, seconds: float) -> None:
        """At the tip, in the base."""
        force_B = np.clip([fx, fy, fz], -STRONGEST_PUSH, STRONGEST_PUSH)
        self._controller.robot.push(force_B, min(max(seconds, 0.0), LONGEST_FAULT))

    def _remote_control(self, on: float) -> None:
        self._controller.remote_control = bool(on)

    def _reset(self) -> None:
        self._counts, self._highest_force = [0, 0, 0], 0.0

    def _status(self) -> dict[str, Any]:
        controller = self._controller
        state = controller.state
        return {
            "time": controller.time,
            "q": state.q.tolist(),
            "qd": state.qd.tolist(),
            "force": self._force,
            "highest_force": self._highest_force,
            "cycles": self._counts,
            "runtime": int(controller.runtime),
            "safety": int(controller.safety),
            "program_error": controller.program_error,
            "cpu_s": time.process_time(),
            "digital_outputs": controller.digital_outputs,
        }


def _is_finite(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


class TwinControl:
    """The twin's control port, from another process."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        """Connect.

        Raises:
            RobotError: No twin listens there.
        """
        try:
            self._socket = socket.create_connection((host, CONTROL_PORT), ANSWER_TIME)
        except OSError as error:
            raise RobotError(
                f"no twin listens at {host}: start one with `breastscan twin`", host
            ) from error
        self._lines = self._socket.makefile("rb")

    def do(self, action: str, **arguments: float | bool) -> dict[str, Any]:
        """Inject a fault, or ask for the `status`.

        Args:
            action: protective_stop, emergency_stop, system_emergency_stop, safeguard_stop, release,
                script_error, close_connections, silence (`seconds`), freeze_sensor, remote_control
                and reduced (`on`), hold (`joint` 1 to 6, `seconds`), push (`fx`, `fy`, `fz` in B
                [N], `seconds`), reset, or status.
            arguments: The action's.

        Raises:
            RobotError: The twin does not know it, or is gone.
        """
        try:
            self._socket.sendall(json.dumps({"do": action, **arguments}).encode() + b"\n")
            line = self._lines.readline()
        except OSError as error:
            raise RobotError(f"the twin does not answer: {error}", error) from error
        answer = json.loads(line) if line else {"ok": False, "error": "the twin is gone"}
        if not answer.pop("ok"):
            raise RobotError(f"the twin refuses {action}: {answer['error']}", action)
        return answer

    def close(self) -> None:
        """Hang up."""
        self._lines.close()
        self._socket.close()
