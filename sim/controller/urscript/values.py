"""What URScript computes with: numbers, booleans, strings, lists, poses and threads, and their
operators.

Values never change: to assign to an element makes a new list, so that no two variables share one.
All have bounds, as on a controller that allocates nothing while it runs.
"""

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.errors import BreastScanError
from breastscan.geometry import se3

LARGEST_INTEGER = 2**31 - 1
"""Integers have 32 bits."""
LONGEST_LIST, DEEPEST_LIST = 1000, 4
"""Elements of a list, those of lists in it included, and how deep they nest."""
LONGEST_STRING = 1024
"""Characters."""
CHARACTERS = 8
"""Of a string count as one element of the list that it stands in."""
SHOWN = 40
"""Characters of a value that a message shows."""

Value = Any
"""A float, int, bool, str, None, a tuple of values, a `Pose`, or a thread."""


class ScriptError(BreastScanError):
    """A program that the controller stops: what it says, or what it does."""

    def __init__(self, message: str, value: object = None, line: int = 0) -> None:
        """What is wrong, with which value, and in which line of the program (0: not known yet)."""
        super().__init__(message, value)
        self.line = line


class Pose(tuple):
    """`p[x, y, z, rx, ry, rz]`; a plain list is joint angles."""

    @staticmethod
    def of(X: Float[np.ndarray, "4 4"]) -> "Pose":
        """That of a transform."""
        return Pose(se3.pose_vector(X).tolist())

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """As a transform."""
        return se3.from_rotation_vector(np.array(self[3:], float), np.array(self[:3], float))


def is_number(value: Value) -> bool:
    """Whether it is an integer or a float; a boolean is neither."""
    return value.__class__ is float or value.__class__ is int


def truth(value: Value) -> bool:
    """What a condition makes of a value; a number is true where it is not 0.

    Raises:
        ScriptError: It is neither a boolean nor a number.
    """
    if value is True or value is False:
        return value
    if is_number(value):
        return value != 0
    raise ScriptError(f"a condition is True or False, got {shown(value)}", value)


def as_text(value: Value) -> str:
    """As the controller writes it."""
    if isinstance(value, tuple):
        return ("p[" if isinstance(value, Pose) else "[") + ", ".join(map(as_text, value)) + "]"
    return str(value)


def shown(value: Value) -> str:
    """For a message: short, and of printable characters alone."""
    text = f'"{value}"' if isinstance(value, str) else as_text(value)
    clean = "".join(letter if letter.isprintable() else "?" for letter in text[: SHOWN + 1])
    return clean if len(clean) <= SHOWN else clean[: SHOWN - 3] + "..."


def make_string(parts: Iterable[Value]) -> str:
    """Strings and other values, joined.

    Raises:
        ScriptError: The result is too long.
    """
    text = "".join(map(as_text, parts))
    if len(text) > LONGEST_STRING:
        raise ScriptError(
            f"a string has {LONGEST_STRING} characters at most, got {len(text)}", len(text)
        )
    return text


def make_list(values: Iterable[Value]) -> tuple[Value, ...]:
    """A list.

    Raises:
        ScriptError: It is too long, or nests too deep.
    """
    made = tuple(values)
    size = -1  # the list itself is among them
    for leaf in _leaves(made, DEEPEST_LIST):
        size += 1 + len(leaf) // CHARACTERS if isinstance(leaf, str) else 1
        if size > LONGEST_LIST:
            raise ScriptError(f"a list has {LONGEST_LIST} elements at most", size)
    return made


def make_pose(values: Iterable[Value]) -> Pose:
    """A pose.

    Raises:
        ScriptError: It is not made of six numbers.
    """
    made = Pose(values)
    if len(made) != 6 or not all(map(is_number, made)):
        raise ScriptError(f"a pose is made of six numbers, got {shown(made)}", made)
    return made


def _leaves(value: Value, depth: int) -> Iterator[Value]:
    if not isinstance(value, tuple):
        yield value
    elif depth == 0:
        raise ScriptError(f"lists nest {DEEPEST_LIST} deep at most", value)
    else:
        yield None  # a list counts, also an empty one
        for element in value:
            yield from _leaves(element, depth - 1)


def element(values: Value, places: Sequence[Value]) -> Value:
    """`values[i]`, or `values[i, j]` of a matrix.

    Raises:
        ScriptError: There is no such element.
    """
    for place in places:
        values = values[_place(values, place)]
    return values


def with_element(values: Value, places: Sequence[Value], new: Value) -> Value:
    """The list or pose with another element at `places`.

    Raises:
        ScriptError: There is no such element, or `new` cannot be one.
    """
    at = _place(values, places[0])
    inner = new if len(places) == 1 else with_element(values[at], places[1:], new)
    changed = (*values[:at], inner, *values[at + 1 :])
    if isinstance(values, Pose):
        return make_pose(changed)
    return changed if is_number(inner) else make_list(changed)


def _place(values: Value, place: Value) -> int:
    if not isinstance(values, tuple):
        raise ScriptError(f"only lists and poses have elements, not {shown(values)}", values)
    if place.__class__ is not int:
        raise ScriptError(f"an index is an integer, got {shown(place)}", place)
    if not 0 <= place < len(values):
        raise ScriptError(f"index {place} of a list of {len(values)}", place)
    return place


def equal(a: Value, b: Value) -> bool:
    """Whether two values are the same; those of different kinds never are."""
    if is_number(a) or is_number(b):
        return a == b and is_number(a) and is_number(b)
    return a.__class__ is b.__class__ and a == b


def _arithmetic(name: str, compute: Callable[[Any, Any], Any]) -> Callable[[Value, Value], Value]:
    """An operator on numbers; on lists, element by element."""

    def apply(a: Value, b: Value) -> Value:
        if (a.__class__ is float or a.__class__ is int) and (
            b.__class__ is float or b.__class__ is int
        ):
            result = compute(a, b)
            if result.__class__ is int and not -LARGEST_INTEGER - 1 <= result <= LARGEST_INTEGER:
                raise ScriptError(f"integer overflow: {a} {name} {b}", result)
            return result
        if a.__class__ is tuple and b.__class__ is tuple and len(a) == len(b):
            return tuple(apply(x, y) for x, y in zip(a, b, strict=True))
        if a.__class__ is tuple and is_number(b):
            return tuple(apply(x, b) for x in a)
        if b.__class__ is tuple and is_number(a):
            return tuple(apply(a, y) for y in b)
        raise ScriptError(f"{shown(a)} {name} {shown(b)} is not defined", (a, b))

    return apply


def _order(name: str, compare: Callable[[Any, Any], bool]) -> Callable[[Value, Value], bool]:
    def apply(a: Value, b: Value) -> bool:
        if not (is_number(a) and is_number(b)):
            raise ScriptError(f"{shown(a)} {name} {shown(b)}: only numbers have an order", (a, b))
        return compare(a, b)

    return apply


def _modulo(a: Any, b: Any) -> Any:
    """With the sign of the dividend, as in C."""
    result = math.fmod(a, b)
    return int(result) if a.__class__ is b.__class__ is int else result


def _negative(value: Value) -> Value:
    return BINARY["*"](-1, value)


BINARY: dict[str, Callable[[Value, Value], Value]] = {
    **{
        name: _arithmetic(name, compute)
        for name, compute in {
            "+": operator.add,
            "-": operator.sub,
            "*": operator.mul,
            "/": operator.truediv,
            "%": _modulo,
        }.items()
    },
    **{
        name: _order(name, compare)
        for name, compare in {
            "<": operator.lt,
            "<=": operator.le,
            ">": operator.gt,
            ">=": operator.ge,
        }.items()
    },
    "==": equal,
    "!=": lambda a, b: not equal(a, b),
    "xor": lambda a, b: truth(a) != truth(b),
}
"""Operators between two values."""
UNARY: dict[str, Callable[[Value], Value]] = {
    "-": _negative,
    "+": lambda value: BINARY["*"](1, value),
    "not": lambda value: not truth(value),
}
"""Operators before a value."""
