"""The command line: it says which commands there are, and imports the one that is asked for."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

import tyro
from rich.console import Console
from rich.markup import escape

from breastscan.checks import require_known
from breastscan.commands import completion, settings
from breastscan.commands.console import twin_imports
from breastscan.errors import BreastScanError, notes_of
from breastscan.run.provenance import unsuited, version_of

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells use it."""

FULL = frozenset((errno.ENOSPC, errno.EDQUOT))
"""Errors of a disk that takes no more."""
HELP = frozenset(("-h", "--help", "--help-all"))

COMMANDS = {
    "scan": "scan the phantom with the twin and measure every error, or scan with a robot",
    "view": "the same scan live, in a window or a browser",
    "reconstruct": "a stereo pair on disk to a point cloud",
    "calibrate": "a pair of cameras, from shots of a chessboard",
    "rig": "what a stereo rig is, from the files of any tool, and files for others",
    "handeye": "the cameras' place in the robot's base, from a board on the flange",
    "plan": "points on disk to a trajectory and a program for a UR controller",
    "compare": "two scans, at equal path length",
    "study": "one question about the twin, answered by figures and tables",
    "twin": "the twin as a UR controller on the network, for any client of one",
    "doctor": "what works on this machine, and how to mend what does not",
}
"""A line of help for each; `breastscan.commands` has a module of its name, and that a function of
its name."""


def usage() -> str:
    """The overview that `breastscan --help` prints."""
    lines = [f"  {name:<12} {summary}" for name, summary in COMMANDS.items()]
    return "\n".join(
        [
            "usage: breastscan COMMAND [OPTIONS]",
            "",
            *lines,
            "",
            "breastscan COMMAND --help lists a command's options, --help-all all its settings.",
            "breastscan --version; breastscan --completion, a script for bash and zsh.",
        ]
    )


def main(arguments: list[str] | None = None) -> None:
    """Run one command; errors that a user can act on end in one line and status 1."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] in ("-h", "--help"):
        print(usage())
        sys.exit(0 if arguments else 2)
    if arguments[0] == "--version":
        print(f"breastscan {version_of('breastscan')}")
        return
    with _errors_told(Console(stderr=True, highlight=False, soft_wrap=True)) as errors:
        _run(errors, *arguments)


def _run(errors: Console, name: str, *arguments: str) -> None:
    if name == "--completion":
        with twin_imports():
            print(completion.script(COMMANDS), end="")
        return
    require_known(name, COMMANDS, "command")
    with twin_imports():
        command = getattr(import_module(f"breastscan.commands.{name}"), name)
    if HELP.intersection(arguments):
        settings.print_help(name, command, Console(), everything="--help-all" in arguments)
        sys.exit(0)
    options, unused = settings.expanded(command, list(arguments))
    if unused:
        errors.print(f"{name} has no use for {', '.join(unused)}")
    tyro.cli(command, args=options, prog=f"breastscan {name}")


@contextmanager
def _errors_told(errors: Console) -> Iterator[Console]:
    """Tell what a user can act on in one line, and end; before it, which packages do not fit."""
    try:
        yield errors
    except (KeyboardInterrupt, SystemError) as error:
        if not _is_interrupt(error):
            raise
        errors.print("Interrupted: earlier results are untouched.")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # of `... | head`: who read has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Exception as error:
        for package in unsuited():
            errors.print(f"[yellow]{package}[/]")
        told = _told(error)
        if told is None:
            raise
        errors.print(told)
        sys.exit(1)


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is what happened: one that falls into a compiled kernel comes out of it at the
    end of a chain of SystemErrors.
    """
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def _told(error: Exception) -> str | None:
    """The line for a user, and the error's notes; None for what only a programmer can act on."""
    if isinstance(error, BreastScanError):
        told = "\n".join(map(escape, [str(error), *notes_of(error)]))
        return f"[red]{type(error).__name__}[/]: {told}"
    if isinstance(error, OSError) and error.errno in FULL:
        return (
            f"[red]{error.strerror}[/]: free some, or choose another folder with --out; earlier "
            "results are untouched."
        )
    return None
