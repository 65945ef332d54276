"""Cuts what arrives at a script port into programs, and into lines outside of one."""

import re

from sim.controller.urscript.values import ScriptError

WORDS = re.compile(r"""\"[^"]*\"|'[^']*'|[#$].*|\b(?:(def|thread|sec|while|if)|(end))\b""")
"""Of a line: what opens a block, and what closes one; not those in strings, comments, labels."""
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
            # a string is of bytes, whatever they mean to whom [UR-script, "str_len"]
            program = self._add(line.decode("latin-1"))
            if program:
                complete.append(program)
        if self._length + len(self._rest) > LONGEST_PROGRAM:
            raise ScriptError(
                f"a program has {LONGEST_PROGRAM} characters at most", None, len(self._lines)
            )
        return complete

    def _add(self, line: str) -> str:
        """Take in a line; the program that it completes."""
        opened, closed = 0, 0
        for words in WORDS.finditer(line):
            opened += words[1] is not None
            closed += words[2] is not None
        bare = line.strip()
        if not self._lines and (not bare or bare[0] in "#$"):
            return ""
        self._lines.append(line)
        self._length += len(line) + 1
        self._depth += opened - closed
        if self._depth > 0:
            return ""
        program = "\n".join(self._lines)
        self._lines = []
        self._depth, self._length = 0, 0
        return program
