"""The command line: it says which commands there are, and imports the one that is asked for."""

import sys
from importlib import import_module

import tyro
from rich.console import Console

from breastscan.checks import require_known
from breastscan.commands.console import twin_imports
from breastscan.errors import BreastScanError
from breastscan.run.provenance import version_of

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells use it."""

COMMANDS = {
    "scan": "scan the phantom with the twin and measure every error, or scan with a robot",
    "view": "the same scan live, in a window or a browser",
    "reconstruct": "a stereo pair on disk to a point cloud",
    "calibrate": "a pair of cameras, from shots of a chessboard",
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
            "breastscan COMMAND --help lists a command's options.",
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
    name, *rest = arguments
    errors = Console(stderr=True)
    try:
        require_known(name, COMMANDS, "command")
        with twin_imports():
            module = import_module(f"breastscan.commands.{name}")
        tyro.cli(getattr(module, name), args=rest, prog=f"breastscan {name}")
    except BreastScanError as error:
        errors.print(f"[red]{type(error).__name__}[/]: {error}", highlight=False, soft_wrap=True)
        sys.exit(1)
    except (KeyboardInterrupt, SystemError) as error:
        # a Ctrl-C that falls into a compiled kernel comes out of it as the cause of a SystemError
        if isinstance(error, SystemError) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        errors.print("Interrupted: earlier results are untouched.")
        sys.exit(INTERRUPTED)
