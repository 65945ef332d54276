"""The dashboard: port 29999, a line for a line [UR-dashboard]."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

from sim.controller import external_control
from sim.controller.controller import LOOPBACK, Controller
from sim.controller.external_control import LONGEST_PROGRAM
from sim.controller.messages import Popup
from sim.controller.states import RobotMode, Runtime
from sim.controller.urscript.values import ScriptError

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL_NUMBER = "20235500001"
"""Digits alone: a client in use takes nothing else."""
PROGRAM_STATES = {Runtime.STOPPED: "STOPPED", Runtime.PLAYING: "PLAYING", Runtime.PAUSED: "PAUSED"}
LOCAL = (
    "Command is not allowed due to safety reasons, please switch robot to Remote Control mode and "
    "reconnect to port 29999"
)
"""To an order, while the pendant keeps the network out."""
TOO_EARLY = (
    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective "
    "stop before unlocking"
)
MODE, OPERATIONAL_MODES = "operational mode", ("MANUAL", "AUTOMATIC")
ROLE, USER_ROLES = "user role", ("PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED")
REPORTS = ("", "controller", "software", "system")
ROOTS = ("ursim", "programs")
"""Folders on a controller in which programs lie; a path may begin there."""
LONGEST_PATH = 200
"""Characters."""
Do = Callable[[Controller], object]


@dataclass(frozen=True)
class Command:
    """One of them."""

    act: Callable[["Dashboard", str], str]
    """Does it, with what stands behind its name, and answers."""
    since: tuple[tuple[int, int] | None, tuple[int, int] | None] = ((3, 0), (5, 0))
    """First version of the older series and of the e-Series that has it, None if none has."""
    orders: bool = False
    """Whether it changes what the arm does, for which the pendant must have handed over."""


class Dashboard:
    """Answers, and keeps what a pendant shows."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        config = controller.config
        self._commands = {
            name.lower(): command
            for name, command in COMMANDS.items()
            if (since := command.since[config.e_series]) and since <= config.numbers
        }
        self.loaded: tuple[str, str | None] | None = None
        """Path of a program, and its text, None where the client brings it."""
        self.address = LOOPBACK
        """Of the machine that gave the latest order."""
        self._request: tuple[str, Generator[None, None, str]] | None = None
        """To a machine, for its program, until that has come."""
        self.chosen = {MODE: "NONE", ROLE: "PROGRAMMER"}

    def answer(self, request: str, address: str = LOOPBACK) -> str:
        """What is said to the request of a machine, having done it."""
        self.address = address
        words = request.strip()
        for name in sorted(self._commands, key=len, reverse=True):
            rest = words[len(name) :]
            if words.lower().startswith(name) and rest[:1] in ("", " "):
                command = self._commands[name]
                if command.orders and not self.controller.hears_the_network:
                    return LOCAL
                return command.act(self, rest.strip())
        return f'could not understand: "{words}"'

    def request_program(self) -> None:
        """Ask the machine that gave the order for its program."""
        coming = external_control.requested(self.address, lambda: self.controller.time)
        self._request = self.address, coming

    def cycle(self) -> None:
        """Run a program that was asked for, once it has come."""
        if self._request is None:
            return
        address, coming = self._request
        try:
            next(coming)
        except StopIteration as come:
            self._request = None
            self.controller.run(come.value, self, address)
        except ScriptError as error:
            self._request = None
            self.controller.report("no program came", error)

    @property
    def program(self) -> str:
        """Name of the loaded one, as states and answers give it."""
        return "null" if self.loaded is None else Path(self.loaded[0]).name


def _load(dashboard: Dashboard, path: str) -> str:
    """A program, by the script that PolyScope saves beside it."""
    file = _found(dashboard.controller.config.programs, path, ".urp")
    brought = file is None and Path(path).name == external_control.PROGRAM
    if file is None and not brought:
        return f"File not found: {path}"
    text = None if file is None else _text(file.with_suffix(".script"))
    if dashboard.controller.runtime is not Runtime.STOPPED or not (text or brought):
        return f"Error while loading program: {path}"
    dashboard.loaded = path, text
    return f"Loading program: {path}"


def _text(script: Path) -> str | None:
    """Of a program, unless there is none or it is too long."""
    if not script.is_file() or script.stat().st_size > LONGEST_PROGRAM:
        return None
    return script.read_text(encoding="utf-8", errors="replace")


def _load_installation(dashboard: Dashboard, path: str) -> str:
    """There is none to be set up here: it only has to exist."""
    file = _found(dashboard.controller.config.programs, path, ".installation")
    return f"File not found: {path}" if file is None else f"Loading installation: {path}"


def _found(root: Path | None, path: str, suffix: str) -> Path | None:
    """A file in the folder of programs, and nowhere else."""
    if root is None or not path.endswith(suffix) or "\0" in path or len(path) > LONGEST_PATH:
        return None
    parts = [part for part in path.split("/") if part]
    while parts and path.startswith("/") and parts[0] in ROOTS:
        parts = parts[1:]
    file = root.joinpath(*parts).resolve()
    return file if file.is_relative_to(root.resolve()) and file.is_file() else None


def _play(dashboard: Dashboard, _: str) -> str:
    controller = dashboard.controller
    if controller.runtime is Runtime.STOPPED and dashboard.loaded and controller.operational:
        text = dashboard.loaded[1]
        if text is None:
            dashboard.request_program()
        else:
            controller.run(text, dashboard)
        return "Starting program"
    return "Starting program" if controller.resume() else "Failed to execute: play"


def _while(states: tuple[Runtime, ...], order: str, act: Do, reply: str) -> Command:
    """What can be done while the program is in one of some states."""

    def do(dashboard: Dashboard, _: str) -> str:
        if dashboard.controller.runtime not in states:
            return f"Failed to execute: {order}"
        act(dashboard.controller)
        return reply

    return Command(do, orders=True)


def _unlock(dashboard: Dashboard, _: str) -> str:
    return "Protective stop releasing" if dashboard.controller.unlock() else TOO_EARLY


def _power(mode: RobotMode, reply: str) -> Command:
    def do(dashboard: Dashboard, _: str) -> str:
        dashboard.controller.power(mode)
        return reply

    return Command(do, orders=True)


def _restart_safety(dashboard: Dashboard, _: str) -> str:
    dashboard.controller.restart_safety()
    return "Restarting safety"


def _popup(dashboard: Dashboard, text: str) -> str:
    popup = dashboard.controller.popup = Popup(text, "Message")
    dashboard.controller.messages.append(popup)
    return "showing popup"


def _close_popup(dashboard: Dashboard, _: str) -> str:
    dashboard.controller.popup = None
    return "closing popup"


def _log(dashboard: Dashboard, text: str) -> str:
    dashboard.controller.tell(text)
    return "Added log message" if text else "No log message to add"


def _choice(what: str, choices: tuple[str, ...], reply: str) -> Callable[["Dashboard", str], str]:
    """One of some words, that is kept and shown."""

    def choose(dashboard: Dashboard, word: str) -> str:
        if word.upper() not in choices:
            return f"Failed setting {what}: {word}"
        dashboard.chosen[what] = word.upper()
        return reply.format(word.upper())

    return choose


def _clear_mode(dashboard: Dashboard, _: str) -> str:
    dashboard.chosen[MODE] = "NONE"
    return "No longer controlling the operational mode. Current operational mode: NONE"


def _report(_: Dashboard, kind: str) -> str:
    """Nothing is written."""
    if kind.lower() not in REPORTS:
        return f"Error: {kind} is no type of report"
    return f"Flight Report generated with id: {SERIAL_NUMBER}"


def _version(dashboard: Dashboard) -> str:
    return ".".join(str(number) for number in dashboard.controller.config.numbers)


def _truth(value: bool) -> str:
    return "true" if value else "false"


def _tells(text: Callable[[Dashboard], str]) -> Callable[[Dashboard, str], str]:
    return lambda dashboard, _: text(dashboard)


E_SERIES_ONLY, OLDER_ONLY = (None, (5, 0)), ((3, 1), None)
REPORTING = ((3, 13), (5, 8))
COMMANDS: dict[str, Command] = {
    "load": Command(_load, orders=True),
    "play": Command(_play, orders=True),
    "stop": _while(
        (Runtime.PLAYING, Runtime.PAUSED), "stop", lambda c: c.stop_program("a client"), "Stopped"
    ),
    "pause": _while((Runtime.PLAYING,), "pause", Controller.pause, "Pausing program"),
    "shutdown": _power(RobotMode.POWER_OFF, "Shutting down"),
    "power on": _power(RobotMode.IDLE, "Powering on"),
    "power off": _power(RobotMode.POWER_OFF, "Powering off"),
    "brake release": _power(RobotMode.RUNNING, "Brake releasing"),
    "unlock protective stop": Command(_unlock, ((3, 1), (5, 0)), orders=True),
    "restart safety": Command(_restart_safety, ((3, 7), (5, 1)), orders=True),
    "load installation": Command(_load_installation, ((3, 2), (5, 0)), orders=True),
    "popup": Command(_popup),
    "close popup": Command(_close_popup),
    "close safety popup": Command(_tells(lambda d: "closing safety popup"), ((3, 1), (5, 0))),
    "addToLog": Command(_log),
    "saveLog": Command(_tells(lambda d: "Log saved to disk"), REPORTING),
    "generate flight report": Command(_report, REPORTING),
    "generate support file": Command(
        lambda d, folder: f"Completed successfully: {folder}/ur_{SERIAL_NUMBER}.zip", REPORTING
    ),
    "PolyscopeVersion": Command(_tells(lambda d: f"URSoftware {_version(d)} (Jan 01 2025)")),
    "version": Command(_tells(_version), E_SERIES_ONLY),
    "get serial number": Command(_tells(lambda d: SERIAL_NUMBER), ((3, 12), (5, 6))),
    "get robot model": Command(_tells(lambda d: d.controller.config.model), ((3, 12), (5, 6))),
    "is in remote control": Command(
        _tells(lambda d: _truth(d.controller.remote_control)), (None, (5, 6))
    ),
    "set operational mode": Command(
        _choice(MODE, OPERATIONAL_MODES, "Operational mode {} is set"), E_SERIES_ONLY, orders=True
    ),
    "get operational mode": Command(_tells(lambda d: d.chosen[MODE]), (None, (5, 6))),
    "clear operational mode": Command(_clear_mode, E_SERIES_ONLY, orders=True),
    "setUserRole": Command(_choice(ROLE, USER_ROLES, "Setting user role: {}"), OLDER_ONLY),
    "getUserRole": Command(_tells(lambda d: d.chosen[ROLE]), OLDER_ONLY),
    "robotmode": Command(_tells(lambda d: f"Robotmode: {d.controller.mode.name}")),
    "safetymode": Command(_tells(lambda d: f"Safetymode: {d.controller.safety.name}")),
    "safetystatus": Command(
        _tells(lambda d: f"Safetystatus: {d.controller.safety.name}"), ((3, 11), (5, 4))
    ),
    "running": Command(
        _tells(lambda d: f"Program running: {_truth(d.controller.runtime is Runtime.PLAYING)}")
    ),
    "programState": Command(
        _tells(lambda d: f"{PROGRAM_STATES[d.controller.runtime]} {d.program}")
    ),
    "get loaded program": Command(
        _tells(lambda d: f"Loaded program: {d.loaded[0]}" if d.loaded else "No program loaded")
    ),
    "isProgramSaved": Command(_tells(lambda d: f"true {d.program}")),
}
"""All of them, as the maker's manual lists them. Flight reports, support files and logs are
answered as done, and nothing is written."""
