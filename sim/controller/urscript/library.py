"""What belongs to the language itself: functions of strings, lists and matrices, and the methods of
lists, structs and matrices [UR-script, "Lists and Structs", "Module internals", "Module urmath"].
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from breastscan.geometry import se3
from sim.controller.urscript.operators import as_lists, matrix
from sim.controller.urscript.signature import (
    ANYTHING,
    CONDITION,
    LIST,
    REFUSED,
    TEXT,
    Function,
    Kind,
    Parameter,
    row,
    whole,
)
from sim.controller.urscript.values import (
    LARGEST_INTEGER,
    LISTS,
    LONGEST_LIST,
    LONGEST_STRING,
    Pose,
    ScriptError,
    Struct,
    Value,
    as_text,
    capacity,
    element,
    elements,
    is_matrix,
    kind,
    make_list,
    make_string,
    shown,
    with_capacity,
)

PRINTABLE = Kind(
    "a string, a number, a boolean, a pose or a list of them",
    lambda value: REFUSED if kind(value) in ("struct", "none", "thread", "handle") else value,
)
SIZED = Kind(
    "a list or a string", lambda value: value if isinstance(value, tuple | str) else REFUSED
)
INDEX = whole(0, LARGEST_INTEGER)
NUMERAL = re.compile(
    r"\s*([+-]?)(?:(0x[0-9a-f]+)|(\d+)|((?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan))",
    re.IGNORECASE | re.ASCII,
)
"""What `to_num` takes: hexadecimal, integer, or float; an exponent makes a float (assumed)."""


def library() -> Iterable[Function]:
    """Rows of the functions."""
    text, other = Parameter("str", TEXT), Parameter("op2", PRINTABLE)
    source, at = Parameter("src", TEXT), Parameter("index", INDEX)
    yield row("str_at", _at, source, at)
    yield row("str_cat", lambda a, b: make_string((a, b)), Parameter("op1", PRINTABLE), other)
    yield row("str_empty", lambda s: not s, text)
    yield row(
        "str_find", str.find, source, Parameter("target", TEXT), Parameter("start_from", INDEX, 0)
    )
    yield row("str_len", len, text)
    yield row("str_sub", _sub, source, at, Parameter("len", INDEX, LARGEST_INTEGER))
    yield row("to_num", _to_number, text)
    yield row("to_str", lambda value: make_string((value,)), Parameter("val", PRINTABLE))
    yield row("length", len, Parameter("v", SIZED))
    yield row("get_list_length", len, Parameter("v", LIST))
    yield row("size", lambda v: _shape(v) if is_matrix(v) else len(v), Parameter("v", SIZED))
    yield row(
        "make_list", _make_list, Parameter("length", whole(0, LONGEST_LIST)),
        Parameter("initial_value", ANYTHING), Parameter("capacity", whole(0, LONGEST_LIST)),
    )  # fmt: skip
    yield row("inv", _inverse, Parameter("m", LIST), costly=True)
    yield row("transpose", _transposed, Parameter("m", LIST))
    yield row("assert", _assert, Parameter("condition", CONDITION))


def _at(text: str, index: int) -> str:
    if index >= len(text):
        raise ScriptError(f"index {index} of a string of {len(text)}", index)
    return text[index]


def _sub(text: str, index: int, length: int) -> str:
    if index > len(text):
        raise ScriptError(f"index {index} of a string of {len(text)}", index)
    return text[index : index + length]


def _to_number(text: str) -> float | int:
    found = NUMERAL.fullmatch(text)
    if found is None:
        raise ScriptError(f"to_num: {shown(text)} is no number", text)
    sign, hexadecimal, integer, _ = found.groups()
    if hexadecimal is None and integer is None:
        return float(text)
    value = int(sign + (hexadecimal or integer), 16 if hexadecimal else 10)
    if not -LARGEST_INTEGER - 1 <= value <= LARGEST_INTEGER:
        raise ScriptError(f"to_num: {shown(text)} is out of range", text)
    return value


def _make_list(length: int, value: Value, room: int) -> Value:
    return with_capacity(make_list([value] * length), room)


def _inverse(value: Value) -> Value:
    if isinstance(value, Pose):
        return Pose.of(se3.inverse(value.matrix))
    M = matrix(value)
    if M is None or M.shape[0] != M.shape[1]:
        raise ScriptError(f"inv: m is a square matrix or a pose, got {shown(value)}", value)
    try:
        return as_lists(np.linalg.inv(M.astype(float)))
    except np.linalg.LinAlgError as error:
        raise ScriptError(f"inv: {shown(value)} is singular", value) from error


def _transposed(value: Value) -> Value:
    """Of a matrix; a list is a row, and a column becomes a list."""
    M = matrix(value if is_matrix(value) else (tuple(value),))
    if M is None:
        raise ScriptError(f"transpose: m is a matrix or a list, got {shown(value)}", value)
    return as_lists(M[:, 0]) if M.shape[1] == 1 else as_lists(M.T)


def _assert(condition: bool) -> None:
    if not condition:
        raise ScriptError("an assertion does not hold")


@dataclass(frozen=True)
class Method:
    """What stands behind a value and a dot."""

    compute: Callable[..., Any]
    """Of the value and the arguments; where it changes the value, the new one and the result."""
    arguments: int
    kinds: tuple[str, ...]
    """Of values that have it."""
    changes: bool = False

    def apply(self, name: str, value: Value, arguments: Sequence[Value]) -> Any:
        """Call it.

        Raises:
            ScriptError: The value has no such method, or not with these arguments.
        """
        if ("matrix" if is_matrix(value) else kind(value)) not in self.kinds:
            raise ScriptError(f"{shown(value)} has no method {shown(name)}", value)
        return self.compute(value, *arguments)


def _shape(values: Value) -> Value:
    return len(values), len(values[0])


def _changed(values: Value, new: Iterable[Value], result: Value = None) -> tuple[Value, Value]:
    """The list with other elements, in its own room."""
    return with_capacity(make_list(new), capacity(values)), result


def _insert(values: Value, index: Value, new: Value) -> tuple[Value, Value]:
    if index != len(values):
        element(values, (index,))
    return _changed(values, (*values[:index], new, *values[index:]))


def _extend(values: Value, more: Value) -> tuple[Value, Value]:
    if more.__class__ not in LISTS:
        raise ScriptError(f"extend takes a list, got {shown(more)}", more)
    return _changed(values, (*values, *more))


def _remove(values: Value, index: Value) -> tuple[Value, Value]:
    gone = element(values, (index,))
    return _changed(values, (*values[:index], *values[index + 1 :]), gone)


def _slice(values: Value, begin: Value, end: Value) -> Value:
    if not (begin.__class__ is end.__class__ is int and 0 <= begin <= end <= len(values)):
        raise ScriptError(
            f"slice from {shown(begin)} to {shown(end)} of a list of {len(values)}", (begin, end)
        )
    return tuple(values[begin:end])


def _to_string(value: Value) -> str:
    text = as_text(value)
    end = "...}" if isinstance(value, Struct) else "...]"
    return text if len(text) <= LONGEST_STRING else text[: LONGEST_STRING - len(end)] + end


ON_LISTS, ON_MATRICES = ("list",), ("matrix",)
METHODS = {
    "append": Method(lambda v, new: _changed(v, (*v, new)), 1, ON_LISTS, changes=True),
    "capacity": Method(capacity, 0, ON_LISTS),
    "clear": Method(lambda v: _changed(v, ()), 0, ON_LISTS, changes=True),
    "excess_capacity": Method(lambda v: capacity(v) - len(v), 0, ON_LISTS),
    "extend": Method(_extend, 1, ON_LISTS, changes=True),
    "insert": Method(_insert, 2, ON_LISTS, changes=True),
    "length": Method(lambda v: len(elements(v)), 0, ("list", "struct", "matrix")),
    "pop": Method(lambda v: _remove(v, len(v) - 1), 0, ON_LISTS, changes=True),
    "remove": Method(_remove, 1, ON_LISTS, changes=True),
    "slice": Method(_slice, 2, ON_LISTS),
    "to_string": Method(_to_string, 0, ("list", "struct", "matrix")),
    "get_column": Method(lambda v, i: tuple(element(r, (i,)) for r in v), 1, ON_MATRICES),
    "get_row": Method(lambda v, i: element(v, (i,)), 1, ON_MATRICES),
    "shape": Method(_shape, 0, ON_MATRICES),
}
"""By name."""
