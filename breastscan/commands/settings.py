"""Settings by the names that `config.json` has for them: on the command line, in a file, in the
help.

A command's settings are the fields of the frozen configs among its parameters. Each has one name,
`scene.phantom.breast`; `--set scene.phantom.breast=dense`, a file given with `--config` and
`--scene.phantom.breast dense` are told to the command line's parser alike, which checks them.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from breastscan.errors import ConfigError
from breastscan.run.unfinished import settings_file
from breastscan.settings import flat, read_file, require_name

REPLACED = ("--set", "--config")
"""Options that stand for others."""
RESUME = "--resume"
"""An option that brings the settings of the scan that it names along."""
BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
"""Words for a setting that is one or the other."""
PROVENANCE = frozenset(("date", "command", "commit", "versions", "robot_found", "yes"))
"""What a `config.json` tells of its run, and no run takes: consent to a contact is given anew."""
OF_OTHERS = frozenset((
    "seed", "video", "fine", "rig", "robot", "cell", "camera", "calibration", "dry_run",
    "link", "resume", "tcp", "plate_height", "urscript", "perception", "planning", "contact",
    "safety", "scene", "board", "twin", "controller", "clock", "out", "web", "host", "port",
    "limits", "lens", "on_flange", "accept",
))  # fmt: skip
"""What a `config.json` may hold that not every command has: left out there, and told."""
EVERYDAY = (
    "contact.force",
    "contact.law",
    "planning.feedrate.speed",
    "planning.pattern.kind",
    "planning.pattern.height_fraction",
    "planning.pattern.points",
    "perception.stereo.min_disparity",
    "perception.stereo.num_disparities",
    "perception.stereo.paths",
    "perception.refine.spacing_px",
    "scene.phantom.breast",
    "scene.phantom.mechanics",
    "scene.phantom.young",
    "scene.phantom.seed",
    "scene.breathing.amplitude",
    "scene.arm.kinematics",
    "scene.camera.quality",
    "scene.wrist.quality",
    "link.slack",
    "controller.host",
    "controller.expose",
    "controller.version",
    "board.columns",
    "board.rows",
    "board.square",
    "clock",
)
"""What a user sets in a normal week; `--help` lists these, `--help-all` all."""


HINT = (
    "Settings: --set NAME=VALUE or --NAME VALUE, as often as needed, or --config FILE, the "
    "config.json of an earlier run or TOML or YAML by hand; what is typed beside it wins."
)
SENTENCE_END = re.compile(r"(?<!Eq)(?<!Eqs)(?<!Sec)(?<!Ch)\. (?=[A-Z])")
CONTINUED = re.compile(r"\n {12,}")
"""Where the text of an argument goes on in a docstring."""
MORE = " --help-all lists all of them; these, with their defaults, are the most used:"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Setting:
    """One number, word or file that a command takes."""

    kind: Any
    """Its type, as annotated."""
    default: Any
    text: str
    """What stands under it in its config; empty for a parameter of the command itself."""


def settings_of(command: Callable) -> dict[str, Setting]:
    """All settings of a command by name, in order; positional arguments have none."""
    hints = get_type_hints(command, include_extras=True)
    found = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if parameter.kind is not parameter.POSITIONAL_ONLY:
            found |= _leaves(name, hints[name], parameter.default, "")
    return found


def _leaves(path: str, hint: Any, default: Any, text: str) -> dict[str, Setting]:
    """The settings at and below a name."""
    path = _named(path, hint)
    if not dataclasses.is_dataclass(default):
        return {path: Setting(kind=_bare(hint), default=default, text=text)}
    hints = get_type_hints(type(default), include_extras=True)
    texts = _texts(type(default))
    found = {}
    for field in dataclasses.fields(default):
        below = f"{path}.{field.name}" if path else field.name
        value = getattr(default, field.name)
        found |= _leaves(below, hints[field.name], value, texts.get(field.name, ""))
    return found


def _named(path: str, hint: Any) -> str:
    """A name, less what an annotation for the command line's parser takes away from it."""
    for mark in getattr(hint, "__metadata__", ()):
        if getattr(mark, "name", None) == "":
            return ""
        if getattr(mark, "prefix_name", None) is False:
            return path.rpartition(".")[2]
    return path


def _bare(hint: Any) -> Any:
    return hint.__origin__ if hasattr(hint, "__metadata__") else hint


def _texts(config: type) -> dict[str, str]:
    """What stands under the fields of a config, and under those that it inherits."""
    found = {}
    for base in reversed(config.__mro__[:-1]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in pairwise(tree.body):
            match field, below:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    found[name] = " ".join(text.split())
    return found


def expanded(command: Callable, arguments: list[str]) -> tuple[list[str], list[str]]:
    """Put options in the place of `--set` and `--config`, and beside `--resume`; a file's come
    first, so that others win.

    Args:
        command: What the arguments are for.
        arguments: As typed, without the command's name.

    Returns:
        The arguments, and what the files hold that is not this command's.

    Raises:
        ConfigError: A file cannot be read, or a name is none of a setting.
    """
    if not any(argument.partition("=")[0] in (*REPLACED, RESUME) for argument in arguments):
        return arguments, []  # nothing to look names up for, which takes a while
    known = settings_of(command)
    typed: list[str] = []
    filed: list[str] = []
    unused: list[str] = []
    rest = iter(arguments)
    for argument in rest:
        option, _, value = argument.partition("=")
        if option not in REPLACED and not (option == RESUME and "resume" in known):
            typed.append(argument)
            continue
        value = value or next(rest, "")
        if option == RESUME:
            typed += [RESUME, value]
            value = str(settings_file(Path(value)))
        if option == "--set":
            typed += _from_text(known, value)
        else:
            filed += _from_file(known, Path(value), unused)
    return filed + typed, unused


def _from_text(known: dict[str, Setting], text: str) -> list[str]:
    """The option of one `NAME=VALUE`."""
    path, equals, value = text.partition("=")
    path = path.replace("-", "_")
    if not equals:
        raise ConfigError(f"--set takes NAME=VALUE, as contact.force=3; got {text!r}", text)
    require_name(path, known)
    if get_origin(known[path].kind) is tuple:
        return _option(path, value.strip("[]() ").replace(",", " ").split(), known[path])
    return _option(path, value, known[path])


def _from_file(known: dict[str, Setting], path: Path, unused: list[str]) -> list[str]:
    """The options of a file."""
    content = read_file(path, "the file of --config")
    found = []

    def holds_settings(name: str) -> bool:
        return any(setting.startswith(f"{_as_typed(name)}.") for setting in known)

    for filed, value in flat(content, holds_settings):
        name = _as_typed(filed)
        top = _top(name)
        if top in PROVENANCE:
            continue
        if top in OF_OTHERS and not any(_top(setting) == top for setting in known):
            unused.append(name)
            continue
        require_name(name, known, f" (in {path})")
        if value is not None or type(None) in get_args(known[name].kind):  # else not set
            found += _option(name, value, known[name])
    return found


def _as_typed(name: str) -> str:
    """A name of a file as settings are named: dashes stand for underscores."""
    return name.replace("-", "_")


def _top(name: str) -> str:
    return name.partition(".")[0]


def require_used(refused: dict[str, bool]) -> None:
    """Accept options none of which would be ignored.

    Args:
        refused: Whether a case is there, by what the user is told of it.

    Raises:
        ConfigError: One is.
    """
    for reason, holds in refused.items():
        if holds:
            raise ConfigError(reason)


def _option(path: str, value: Any, setting: Setting) -> list[str]:
    """A setting as the parser takes it.

    Raises:
        ConfigError: It is one of true and false, and the value is neither; or it takes one value,
            and there are several.
    """
    group, dot, name = path.replace("_", "-").rpartition(".")
    if bool in (setting.kind, *get_args(setting.kind)):
        value = BOOLEANS.get(str(value).lower(), value)
    if setting.kind is bool:
        if not isinstance(value, bool):
            raise ConfigError(f"{path} is true or false, got {value!r}", value)
        return [f"--{group}{dot}{'' if value else 'no-'}{name}"]
    if isinstance(value, dict) or (
        isinstance(value, list) and get_origin(setting.kind) is not tuple
    ):
        raise ConfigError(
            f"{path} takes one value, got {value!r}; a force law of one's own is for Python", value
        )
    values = value if isinstance(value, list) else [value]
    return [f"--{group}{dot}{name}", *map(str, values)]


def print_help(name: str, command: Callable, console: Console, *, everything: bool) -> None:
    """Print a command's options, then its settings by name."""
    with suppress(SystemExit):
        tyro.cli(_without_settings(command), args=["--help"], prog=f"breastscan {name}")
    shown = Table(box=None, show_header=False, padding=(0, 1), pad_edge=False)
    for path, setting in settings_of(command).items():
        if setting.text and (everything or path in EVERYDAY):
            told = _told(setting, everything=everything)
            shown.add_row(f"  {path}", _default(setting.default), told)
    if shown.row_count:
        console.print(HINT if everything else HINT + MORE, highlight=False)
        console.print(shown)


def _without_settings(command: Callable) -> Callable:
    """A command of the same help whose parameters are only those that are no configs."""

    @wraps(command)
    def shown(*_: object, **__: object) -> None:
        raise AssertionError("asked for its help alone")

    signature = inspect.signature(command)
    plain = [
        parameter
        for parameter in signature.parameters.values()
        if not dataclasses.is_dataclass(parameter.default)
    ]
    del shown.__wrapped__  # the parser would read its docstring instead  # pyright: ignore
    shown.__signature__ = signature.replace(parameters=plain)  # pyright: ignore
    hints = get_type_hints(command, include_extras=True)
    # the parser breaks its lines where the docstring has them, and again where they are too long
    shown.__doc__ = CONTINUED.sub(" ", command.__doc__ or "")
    shown.__annotations__ = {parameter.name: hints[parameter.name] for parameter in plain}
    return shown


def _told(setting: Setting, *, everything: bool) -> str:
    """Its text, the first sentence unless everything is asked for, and the choices."""
    text = setting.text if everything else SENTENCE_END.split(setting.text)[0].removesuffix(".")
    choices = next(filter(_is_literal, (setting.kind, *get_args(setting.kind))), None)
    if choices is not None:
        text += f" {{{', '.join(map(str, get_args(choices)))}}}"
    return escape(text)


def _is_literal(kind: object) -> bool:
    return get_origin(kind) is Literal


def _default(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
