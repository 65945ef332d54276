"""What a controller tells whoever listens; `primary` and `rtde` say how it looks on the wire."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ProgramError:
    """What ended a program, or kept it from beginning."""

    text: str
    line: int
    """Of the program; 0 where that is not known."""
    column: int = 0
    """Likewise."""


@dataclass(frozen=True)
class Text:
    """What a program tells by `textmsg`."""

    text: str


@dataclass(frozen=True)
class Popup:
    """What a program shows the operator."""

    text: str
    title: str
    warning: bool = False
    error: bool = False
    blocking: bool = False


@dataclass(frozen=True)
class Key:
    """What became of a program."""

    title: str
    """`PROGRAM_XXX_STARTED` or `PROGRAM_XXX_STOPPED`."""
    text: str
    """Its name."""


@dataclass(frozen=True)
class SafetyChange:
    """The safety system has gone to another mode."""

    mode: int


@dataclass(frozen=True)
class Code:
    """One of the maker's numbered messages, as `C204A3: joint 4 would jump`."""

    code: int
    argument: int
    text: str
    """What has been measured, in words of our own."""
    stops: bool = True
    """Whether it stopped the arm."""


Message = ProgramError | Text | Popup | Code | Key | SafetyChange
