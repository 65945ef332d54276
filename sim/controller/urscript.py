"""URScript to Python: every function becomes a generator that yields wherever the controller's period ends.

Covers what client libraries upload: nested functions and threads, conditions and loops, poses, globals. Blocking
functions of the controller, and the script's own, are called with `yield from`; what runs for 2 ms on the robot runs
here up to the next yield.
"""

import ast
import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType

from breastscan.errors import BreastScanError

OPENING = re.compile(r"(def|thread|sec|while|if|for)\b.*:$")
FUNCTION = re.compile(r"(def|thread|sec)\s+(\w+)\s*\((.*)\)\s*:$")
BRANCH = re.compile(r"(elif\b.*|else\s*):$")
DECLARED = re.compile(r"(?:global|local)\s+([A-Za-z_]\w*)\s*(=(?!=).*)?$")
ASSIGNED = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\[[^=]*\])?\s*=(?!=)")
SPLIT_VALUE = re.compile(r"(-?[\d.]+)\s*(.*)$")
WORD = re.compile(r"\"[^\"]*\"|'[^']*'|[A-Za-z_]\w*")
POSE = re.compile(r"(?<![\w\])])p\s*\[")
SHARED_WORDS = frozenset(
    ["and", "or", "not", "if", "elif", "else", "while", "for", "in", "return", "break", "continue", "True", "False"]
)
"""Keywords of both languages; a name that is one of Python's alone (`async`) gets a tail."""
IGNORED = frozenset({"enter_critical", "exit_critical"})
"""Threads are cooperative here: nothing comes between."""


class ScriptError(BreastScanError):
    """A program that the controller would stop: what it says, or what it does."""


class Splitter:
    """Cuts what arrives at a script port into programs, and into lines outside of one."""

    def __init__(self) -> None:
        self._rest, self._lines, self._depth = "", [], 0

    def feed(self, data: bytes) -> list[str]:
        """The programs and lines that are complete now; packets may end anywhere."""
        complete = []
        *lines, self._rest = (self._rest + data.decode("utf-8", "replace")).split("\n")
        for line in lines:
            bare = without_comment(line)
            if not bare and not self._lines:
                continue
            self._lines.append(line)
            self._depth += 1 if OPENING.match(bare) else -1 if bare == "end" else 0
            if self._depth <= 0:
                complete.append("\n".join(self._lines))
                self._lines, self._depth = [], 0
        return complete


@dataclass(frozen=True)
class Script:
    """A translated program."""

    name: str
    """Of its main function."""
    code: CodeType
    threads: frozenset[str]

    def load(self, functions: dict[str, Callable]) -> Callable:
        """Its main function, in a world of these functions of the controller."""
        namespace = dict(functions)
        exec(self.code, namespace)
        return namespace[self.name]


@dataclass
class _Function:
    name: str
    parameters: str
    body: list[str] = field(default_factory=list)
    depth: int = 1


@lru_cache(maxsize=16)
def translate(source: str, blocking: frozenset[str]) -> Script:
    """Translate a program; the same text is translated once.

    Args:
        source: The program, from `def` to `end`.
        blocking: Functions of the controller that take time.

    Raises:
        ScriptError: It is no program that is understood here.
    """
    lines = _joined([bare for bare in map(without_comment, source.split("\n")) if bare])
    heads = [head for head in map(FUNCTION.match, lines) if head]
    if not heads or not FUNCTION.match(lines[0]):
        raise ScriptError("a program begins with `def name():`", lines[:1])
    threads = frozenset(head[2] for head in heads if head[1] == "thread")
    generators = blocking | {head[2] for head in heads} - threads
    module = "\n".join(_python(lines))
    try:
        tree = _Waiting(generators).visit(ast.parse(module))
        code = compile(ast.fix_missing_locations(tree), f"<{heads[0][2]}>", "exec")
    except SyntaxError as error:
        raise ScriptError(f"the program {heads[0][2]} is not understood: {error.msg}: {error.text}", error) from error
    return Script(heads[0][2], code, threads)


def without_comment(line: str) -> str:
    """A line without what stands behind #, outside of quotes, and without blanks around it."""
    quoted = ""
    for i, letter in enumerate(line):
        if letter == quoted:
            quoted = ""
        elif not quoted and letter in "\"'":
            quoted = letter
        elif not quoted and letter == "#":
            return line[:i].strip()
    return line.strip()


def _joined(lines: list[str]) -> list[str]:
    """Lines of which none ends in the middle of an assignment: its value may stand at the head of the next one."""
    whole: list[str] = []
    for line in lines:
        value = SPLIT_VALUE.match(line) if whole and re.search(r"[^=]=$", whole[-1]) else None
        if value:
            whole[-1] += " " + value[1]
            line = value[2]
        if line:
            whole.append(line)
    return whole


def _python(lines: list[str]) -> list[str]:
    """The lines of a Python module with a generator for each function."""
    shared = {_renamed(match[1]) for match in map(DECLARED.match, lines) if match and match[0].startswith("global")}
    open_functions: list[_Function] = []
    open_blocks: list[bool] = []
    """Whether each open block is a function."""
    done: list[str] = []
    for line in lines:
        head = FUNCTION.match(line)
        if head:
            open_functions.append(_Function(head[2], _renamed(head[3])))
            open_blocks.append(True)
        elif not open_functions:
            raise ScriptError(f"this stands outside of any program: {line}", line)
        elif line == "end":
            if open_blocks.pop():
                done += _closed(open_functions.pop(), shared)
            else:
                open_functions[-1].depth -= 1
        else:
            open_blocks += _add(open_functions[-1], line)
    if open_blocks:
        raise ScriptError("the program has no `end`", lines[0])
    return done


def _add(function: _Function, line: str) -> list[bool]:
    """Append a line to a function's body; a block that it opens."""
    if BRANCH.match(line):
        function.body += [" " * (function.depth - 1) + _renamed(line), " " * function.depth + "pass"]
        return []
    if OPENING.match(line):
        function.body += [" " * function.depth + _renamed(line), " " * (function.depth + 1) + "pass"]
        function.depth += 1
        return [False]
    declared = DECLARED.match(line)
    if declared:
        line = f"{declared[1]} {declared[2]}" if declared[2] else ""
    if line and line not in IGNORED:
        line = "halt()" if line == "halt" else line
        line = re.sub(r"\brun\s+(\w+)\s*\(\s*", r"__run(\1, ", line)
        line = re.sub(r"\bkill\s+(\w+)", r"__kill(\1)", line)
        function.body.append(" " * function.depth + _renamed(line))
    return []


def _closed(function: _Function, shared: set[str]) -> list[str]:
    assigned = {match[1] for match in map(ASSIGNED.match, function.body) if match}
    parameters = {name.split("=")[0].strip() for name in function.parameters.split(",")}
    outside = sorted((assigned & shared) - parameters)
    declaration = [f" global {', '.join(outside)}"] if outside else []
    # the last line is never reached; it makes a generator of a function that never waits
    return [f"def {function.name}({function.parameters}):", *declaration, *function.body, " return None", " yield"]


def _renamed(text: str) -> str:
    """With pose literals as calls, and without names that Python keeps for itself."""
    return WORD.sub(_word, _with_poses(text))


def _word(match: re.Match[str]) -> str:
    word = match[0]
    return word + "_" if keyword.iskeyword(word) and word not in SHARED_WORDS else word


def _with_poses(text: str) -> str:
    """`p[x, y, z, rx, ry, rz]` as `__pose([...])`; an index into a variable p stays."""
    for match in reversed(list(POSE.finditer(text))):
        depth, end = 1, match.end()
        commas = 0
        while end < len(text) and depth:
            depth += (text[end] in "[(") - (text[end] in "])")
            commas += text[end] == "," and depth == 1
            end += 1
        if commas == 5:
            text = f"{text[: match.start()]}__pose([{text[match.end() : end - 1]}]){text[end:]}"
    return text


class _Waiting(ast.NodeTransformer):
    """Calls of generators wait for them."""

    def __init__(self, generators: frozenset[str] | set[str]) -> None:
        self._generators = generators

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Wrap a call."""
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self._generators:
            return ast.YieldFrom(value=node)
        return node
