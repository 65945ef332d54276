"""The dashboard: port 29999, a line for a line."""

from collections.abc import Callable

from sim.controller.controller import Controller
from sim.controller.states import RobotMode, Runtime

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER = "20235500001"
"""Digits alone: a client in use takes nothing else."""
PROGRAM_STATES = {Runtime.STOPPED: "STOPPED", Runtime.PLAYING: "PLAYING", Runtime.PAUSED: "PAUSED"}


def answer(request: str, controller: Controller) -> str:
    """What the dashboard says to a request, having done it."""
    words = request.strip()
    known = _ANSWERS.get(words.lower())
    if known is not None:
        return known(controller)
    for start, reply in _BEGINNINGS.items():
        if words.lower().startswith(start):
            return reply + words[len(start) :] if reply.endswith(" ") else reply
    return f'could not understand: "{words}"'


def _version(controller: Controller) -> str:
    return ".".join(str(number) for number in controller.config.numbers)


def _truth(value: bool) -> str:
    return "true" if value else "false"


def _play(controller: Controller) -> str:
    return "Starting program" if controller.resume() else "Failed to execute: play"


def _stop(controller: Controller) -> str:
    controller.stop_program("the dashboard")
    return "Stopped"


def _pause(controller: Controller) -> str:
    controller.pause()
    return "Pausing program"


def _unlock(controller: Controller) -> str:
    if controller.unlock():
        return "Protective stop releasing"
    return (
        "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of "
        "protective stop before unlocking"
    )


def _power(mode: RobotMode, reply: str) -> Callable[[Controller], str]:
    def act(controller: Controller) -> str:
        controller.power(mode)
        return reply

    return act


def _restart_safety(controller: Controller) -> str:
    controller.restart_safety()
    return "Restarting safety"


_ANSWERS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": lambda c: f"URSoftware {_version(c)} (Jan 01 2025)",
    "version": _version,
    "get serial number": lambda c: SERIAL_NUMBER,
    "get robot model": lambda c: c.config.model,
    "is in remote control": lambda c: _truth(c.remote_control),
    "robotmode": lambda c: f"Robotmode: {c.mode.name}",
    "safetymode": lambda c: f"Safetymode: {c.safety.name}",
    "safetystatus": lambda c: f"Safetystatus: {c.safety.name}",
    "running": lambda c: f"Program running: {_truth(c.runtime is Runtime.PLAYING)}",
    "programstate": lambda c: f"{PROGRAM_STATES[c.runtime]} null",
    "get loaded program": lambda c: "No program loaded",
    "isprogramsaved": lambda c: "true null",
    "play": _play,
    "stop": _stop,
    "pause": _pause,
    "unlock protective stop": _unlock,
    "power on": _power(RobotMode.IDLE, "Powering on"),
    "power off": _power(RobotMode.POWER_OFF, "Powering off"),
    "brake release": _power(RobotMode.RUNNING, "Brake releasing"),
    "restart safety": _restart_safety,
    "close safety popup": lambda c: "closing safety popup",
    "close popup": lambda c: "closing popup",
    "shutdown": lambda c: "Shutting down",
}
_BEGINNINGS = {
    "popup": "showing popup",
    "addtolog": "Added log message",
    "load ": "File not found: ",
    "setuserrole ": "Setting user role: ",
}
