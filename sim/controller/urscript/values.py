"""What URScript computes with: numbers, booleans, strings, lists, structs, poses and threads;
`operators` has what stands between them.

Values never change: to assign to an element makes a new list, so that no two variables share one.
All have bounds, as on a controller that allocates nothing while it runs.
"""

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from breastscan.errors import BreastScanError
from breastscan.geometry import se3

LARGEST_INTEGER = 2**31 - 1
"""Integers have 32 bits."""
LONGEST_LIST, DEEPEST_LIST = 1000, 4
"""Elements of a list, those of lists in it included, and how deep they nest."""
LONGEST_STRING = 1023
"""Characters, each a byte [UR-script, "str_cat"]."""
DECIMALS = 6
"""Of a float in a string."""
CHARACTERS = 8
"""Of a string count as one element of the list that it stands in."""
SHOWN = 40
"""Characters of a value that a message shows."""

Value = Any
"""A float, int, bool, str, None, a tuple of values, a `List`, a `Pose`, a `Struct` or a thread."""


class ScriptError(BreastScanError):
    """A program that the controller stops: what it says, or what it does."""

    def __init__(
        self, message: str, value: object = None, line: int = 0, column: int = 0, told: str = ""
    ) -> None:
        """What is wrong, with which value, where in the program (0: not known yet), and what a
        controller calls that, where it is known.
        """
        super().__init__(message, value)
        self.line, self.column = line, column
        self.told = told or message


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


class List(tuple):
    """A list that has room for more elements; one without is a plain tuple."""

    capacity: int

    def __new__(cls, values: Iterable[Value], capacity: int) -> "List":
        """With so much room."""
        made = super().__new__(cls, values)
        made.capacity = capacity
        return made


LISTS = frozenset({tuple, List})


class Key(str):
    """A member's name, in place of an index."""


@dataclass(frozen=True, slots=True)
class Struct:
    """Values with names [UR-script, "Lists and Structs"]."""

    members: Mapping[str, Value]


@dataclass(frozen=True, eq=False)
class Remote:
    """A server whose functions a program calls as methods."""

    url: str
    call: Callable[[str, Sequence[Value]], Generator[None, None, Value]]
    """Of a function's name and its arguments; waits for what comes of it."""

    def __str__(self) -> str:
        return self.url


COMPOUND = LISTS | {Struct}
"""Classes of values of which `assigned` may make others."""


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
    if isinstance(value, Struct):
        pairs = (f"{name}: {as_text(member)}" for name, member in value.members.items())
        return "{" + ", ".join(pairs) + "}"
    if value.__class__ is float and math.isfinite(value):
        text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text
    return str(value)


def shown(value: Value, longest: int = SHOWN, *, quoted: bool = True) -> str:
    """For a message: short, and of printable characters alone."""
    text = f'"{value}"' if isinstance(value, str) and quoted else as_text(value)
    clean = "".join(letter if letter.isprintable() else "?" for letter in text[: longest + 1])
    return clean if len(clean) <= longest else clean[: longest - 3] + "..."


def not_found(message: str, name: str, line: int, column: int) -> ScriptError:
    """What is said of a name that means nothing."""
    told = f"compile_error_name_not_found:{shown(name, quoted=False)}:"
    return ScriptError(message, None, line, column, told)


def first_column(source: str, line: int) -> int:
    """Where a line of a program has its first word; 0 where it has none."""
    lines = source.split("\n")
    text = lines[line - 1].rstrip() if 0 < line <= len(lines) else ""
    return len(text) - len(text.lstrip()) + 1 if text else 0


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
    _check_size(made)
    return made


def make_struct(members: Iterable[tuple[str, Value]]) -> Struct:
    """A struct.

    Raises:
        ScriptError: It is too long, or nests too deep.
    """
    made = Struct(dict(members))
    _check_size(made)
    return made


def _check_size(value: Value) -> None:
    size = -1  # the value itself is among them
    for leaf in _leaves(value, DEEPEST_LIST):
        size += 1 + len(leaf) // CHARACTERS if isinstance(leaf, str) else 1
        if size > LONGEST_LIST:
            raise ScriptError(f"a list has {LONGEST_LIST} elements at most", size)


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
    if not isinstance(value, tuple | Struct):
        yield value
    elif depth == 0:
        raise ScriptError(f"lists nest {DEEPEST_LIST} deep at most", value)
    else:
        yield None  # a list counts, also an empty one
        for part in elements(value):
            yield from _leaves(part, depth - 1)


def elements(values: Value) -> tuple[Value, ...]:
    """Of a list or pose, or the members of a struct, in order.

    Raises:
        ScriptError: It has none.
    """
    if isinstance(values, Struct):
        return tuple(values.members.values())
    if not isinstance(values, tuple):
        raise ScriptError(f"only lists and poses have elements, not {shown(values)}", values)
    return values


def element(values: Value, places: Sequence[Value]) -> Value:
    """`values[i]`, `values[i, j]` of a matrix, or `values.name` of a struct.

    Raises:
        ScriptError: There is no such element.
    """
    for place in places:
        values = elements(values)[_place(values, place)]
    return values


def with_element(values: Value, places: Sequence[Value], new: Value) -> Value:
    """The list, pose or struct with another element at `places`.

    Raises:
        ScriptError: There is no such element, or `new` cannot be one.
    """
    at = _place(values, places[0])
    parts = elements(values)
    inner = new if len(places) == 1 else with_element(parts[at], places[1:], new)
    if isinstance(values, Struct):
        return _with_member(values, at, inner)
    changed = (*parts[:at], inner, *parts[at + 1 :])
    if isinstance(values, Pose):
        return make_pose(changed)
    if not is_number(inner):
        _check_size(changed)
    return List(changed, values.capacity) if isinstance(values, List) else changed


def _with_member(values: Struct, at: int, new: Value) -> Struct:
    name, old = list(values.members.items())[at]
    if kind(new) != kind(old):
        raise ScriptError(f"member {name} is a {kind(old)} and stays one, got {shown(new)}", new)
    return make_struct({**values.members, name: assigned(old, new)}.items())


def _place(values: Value, place: Value) -> int:
    if place.__class__ is Key:
        if not isinstance(values, Struct) or place not in values.members:
            raise ScriptError(f"{shown(values)} has no member {place}", values)
        return list(values.members).index(place)
    count = len(elements(values))
    if place.__class__ is not int:
        raise ScriptError(f"an index is an integer, got {shown(place)}", place)
    if not 0 <= place < count:
        raise ScriptError(f"index {place} of a list of {count}", place)
    return place


def kind(value: Value) -> str:
    """The fundamental type of a value, in a word."""
    return _KINDS.get(value.__class__, "thread")


_KINDS = {
    int: "number", float: "number", bool: "bool", str: "string", type(None): "none",
    tuple: "list", List: "list", Pose: "pose", Struct: "struct",
    Remote: "handle",
}  # fmt: skip


def capacity(values: tuple[Value, ...]) -> int:
    """How many elements a list has room for."""
    return values.capacity if isinstance(values, List) else len(values)


def with_capacity(values: tuple[Value, ...], room: int) -> tuple[Value, ...]:
    """The list, with room for so many elements.

    Raises:
        ScriptError: That is less than it has.
    """
    if len(values) > room:
        raise ScriptError(f"a list with room for {room} elements gets {len(values)}", values)
    return tuple(values) if len(values) == room else List(values, room)


def assigned(old: Value, new: Value) -> Value:
    """What a variable that holds `old` holds once `new` is assigned to it: a list keeps its room
    [UR-script, "List"], and takes the members of a struct.

    Raises:
        ScriptError: A list has no room for `new`.
    """
    if old.__class__ not in LISTS or new.__class__ not in COMPOUND:
        return new
    values = elements(new)
    if is_matrix(old) or is_matrix(values):
        return new
    return with_capacity(values, capacity(old))


def is_matrix(value: Value) -> bool:
    """Whether it is a list of lists."""
    return value.__class__ in LISTS and bool(value) and value[0].__class__ in LISTS


def equal(a: Value, b: Value) -> bool:
    """Whether two values are the same; those of different kinds never are."""
    if is_number(a) or is_number(b):
        return a == b and is_number(a) and is_number(b)
    return a == b and (a.__class__ is b.__class__ or {a.__class__, b.__class__} <= LISTS)
