"""Cuts what arrives at a script port into programs, and into lines outside of one."""

import re

from sim.controller.urscript.values import ScriptError

OPENING = re.compile(r"(?:def|thread|sec|while|if|for|switch)\b.*:$")
LONGEST_PROGRAM = 1_000_000
"""Characters."""


class Splitter:
    """Of one connection."""

    def __init__(self) -> None:
        self._rest = b""
        self._lines: list[str] = []
        self._depth, self._length = 0, 0

    def feed(self, data: bytes) -> list[str]:
        """The programs and lines that are complete now; packets may end anywhere.

        Raises:
            ScriptError: A program is too long.
        """
        complete = []
        *lines, rest = data.split(b"\n")
        if lines:
            lines[0] = self._rest + lines[0]
            self._rest = rest
        else:
            self._rest += rest
        for line in lines:
            program = self._add(line.decode("utf-8", "replace"))
            if program:
                complete.append(program)
        if self._length + len(self._rest) > LONGEST_PROGRAM:
            raise ScriptError(
                f"a program has {LONGEST_PROGRAM} characters at most", None, len(self._lines)
            )
        return complete

    def _add(self, line: str) -> str:
        """Take in a line; the program that it completes."""
        bare = without_comment(line)
        if not bare and not self._lines:
            return ""
        self._lines.append(line)
        self._length += len(line) + 1
        self._depth += 1 if OPENING.match(bare) else -1 if bare == "end" else 0
        if self._depth > 0:
            return ""
        program = "\n".join(self._lines)
        self._lines = []
        self._depth = 0
        self._length = 0
        return program


def without_comment(line: str) -> str:
    """A line without what stands behind #, outside of quotes, and without blanks around it."""
    if "#" not in line:
        return line.strip()
    quoted = ""
    for i, letter in enumerate(line):
        if letter == quoted:
            quoted = ""
        elif not quoted and letter in "\"'":
            quoted = letter
        elif not quoted and letter == "#":
            return line[:i].strip()
    return line.strip()
