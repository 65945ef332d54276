"""How a function of the controller is described to programs: its name, its parameters and what
it does.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.controller.urscript.values import (
    LARGEST_INTEGER,
    Pose,
    ScriptError,
    Value,
    is_number,
    shown,
    truth,
)

REQUIRED: Any = object()
"""In place of a default: there is none."""
LARGEST_COORDINATE = 1e6
"""In a list that stands for a place, a speed or a force: nothing of an arm is larger, in whatever
unit."""
REFUSED: Any = object()
"""In place of an argument: the parameter takes no such value."""


@dataclass(frozen=True)
class Kind:
    """What a parameter takes."""

    name: str
    take: Callable[[Value], Any]
    """Makes of a value what the function gets, or `REFUSED`."""


@dataclass(frozen=True)
class Parameter:
    """One of a function's."""

    name: str
    kind: Kind
    default: Any = REQUIRED


@dataclass(frozen=True)
class Function:
    """Something that programs can call."""

    name: str
    call: Callable[..., Any]
    parameters: tuple[Parameter, ...]
    waits: bool = False
    """Whether it takes simulated time: `call` makes a generator then, which waits for a period at
    each `yield`."""
    costly: bool = False
    """Whether it takes more than some microseconds of the processor: the clock is checked after
    it."""

    @property
    def is_step(self) -> bool:
        """Whether a call of it is a step of its own."""
        return self.waits or self.costly

    def refusal(self, parameter: Parameter, value: Value) -> ScriptError:
        """What is said of an argument that a parameter does not take."""
        return ScriptError(
            f"{self.name}: {parameter.name} is {parameter.kind.name}, got {shown(value)}", value
        )


def row(
    name: str,
    call: Callable[..., Any],
    *parameters: Parameter,
    waits: bool = False,
    costly: bool = False,
) -> Function:
    """A function of the controller, as a row of a table."""
    return Function(name, call, parameters, waits, costly)


def table(rows: Iterable[Function]) -> dict[str, Function]:
    """Functions by name."""
    return {function.name: function for function in rows}


def _number(value: Value) -> Any:
    return float(value) if is_number(value) and math.isfinite(value) else REFUSED


def _positive(value: Value) -> Any:
    return float(value) if _number(value) is not REFUSED and value > 0 else REFUSED


def _condition(value: Value) -> Any:
    return truth(value) if isinstance(value, bool) or is_number(value) else REFUSED


def _numbers(count: int, make: Callable[[Value], Any]) -> Callable[[Value], Any]:
    def take(value: Value) -> Any:
        fits = (
            isinstance(value, tuple)
            and len(value) == count
            and all(is_number(part) and abs(part) <= LARGEST_COORDINATE for part in value)
        )
        return make(value) if fits else REFUSED

    return take


def _array(value: Value) -> Any:
    return np.array(value, float)


def _place(value: Value) -> Any:
    return POSE.take(value) if isinstance(value, Pose) else JOINTS.take(value)


def whole(low: int, high: int) -> Kind:
    """An integer within bounds; a float that is whole counts as one."""

    def take(value: Value) -> Any:
        if value.__class__ is float and value.is_integer():
            value = int(value)
        return value if value.__class__ is int and low <= value <= high else REFUSED

    return Kind(f"an integer from {low} to {high}", take)


def choice(*words: str) -> Kind:
    """One of some strings."""
    return Kind("one of " + ", ".join(words), lambda value: value if value in words else REFUSED)


def up_to(highest: float) -> Kind:
    """A number from 0."""
    return Kind(
        f"a number from 0 to {highest:g}",
        lambda value: float(value) if is_number(value) and 0 <= value <= highest else REFUSED,
    )


NUMBER = Kind("a number", _number)
POSITIVE = Kind("a positive number", _positive)
INTEGER = whole(-LARGEST_INTEGER - 1, LARGEST_INTEGER)
CONDITION = Kind("True or False", _condition)
TEXT = Kind("a string", lambda value: value if isinstance(value, str) else REFUSED)
ANYTHING = Kind("anything", lambda value: value)
LIST = Kind("a list", lambda value: value if isinstance(value, tuple) else REFUSED)
VECTOR = Kind("three numbers", _numbers(3, _array))
JOINTS = Kind("six numbers", _numbers(6, _array))
POSE = Kind("a pose", _numbers(6, Pose))
"""Also where a program has it in a plain list."""
PLACE = Kind("a pose or six joint angles", _place)
"""A `Pose`, or an array of joint angles."""
