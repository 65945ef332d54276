"""The operators of URScript, between values and before one."""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from sim.controller.urscript.values import (
    LARGEST_INTEGER,
    LISTS,
    LONGEST_LIST,
    ScriptError,
    Value,
    equal,
    is_matrix,
    is_number,
    make_string,
    shown,
    truth,
)


def _arithmetic(name: str, compute: Callable[[Any, Any], Any]) -> Callable[[Value, Value], Value]:
    """An operator on numbers, and on lists and matrices of them."""

    def apply(a: Value, b: Value) -> Value:
        if (a.__class__ is float or a.__class__ is int) and (
            b.__class__ is float or b.__class__ is int
        ):
            result = compute(a, b)
            if result.__class__ is int and not -LARGEST_INTEGER - 1 <= result <= LARGEST_INTEGER:
                raise ScriptError(f"integer overflow: {a} {name} {b}", result)
            return result
        if name == "+" and a.__class__ is str and b.__class__ is str:
            return make_string((a, b))
        result = _on_lists(name, apply, a, b)
        if result is None:
            raise ScriptError(f"{shown(a)} {name} {shown(b)} is not defined", (a, b))
        return result

    return apply


def _on_lists(name: str, apply: Callable[[Value, Value], Value], a: Value, b: Value) -> Value:
    """Lists of one length element by element, a number with each element, and the products of a
    matrix; None where it is not defined [UR-script, "Matrix and Array Expressions"].
    """
    left, right = a.__class__ in LISTS, b.__class__ in LISTS
    if left and is_number(b):
        return tuple(apply(x, b) for x in a)
    if right and is_number(a):
        return tuple(apply(a, y) for y in b)
    if not (left and right):
        return None
    if name == "*" and is_matrix(a):
        return _product(a, b)
    # sums of matrices are assumed: the manual names lists alone
    same = is_matrix(a) is is_matrix(b) and (name in "+-" or not is_matrix(a))
    if not same or len(a) != len(b):
        return None
    return tuple(apply(x, y) for x, y in zip(a, b, strict=True))


def matrix(value: Value) -> np.ndarray | None:
    """Of numbers, n by m, as an array; None where it is none."""
    if not is_matrix(value) or not all(row.__class__ in LISTS for row in value):
        return None
    if len({len(row) for row in value}) != 1 or not value[0]:
        return None
    return np.array(value) if all(is_number(x) for row in value for x in row) else None


def _product(a: Value, b: Value) -> Value:
    """Of a matrix and a matrix or a list, the result within bounds; else None."""
    A = matrix(a)
    B = matrix(b) if is_matrix(b) else np.array(b) if all(map(is_number, b)) else None
    if A is None or B is None or A.shape[1] != len(B):
        return None
    if len(A) * (B.size // len(B)) > LONGEST_LIST:
        raise ScriptError(f"a list has {LONGEST_LIST} elements at most", (a, b))
    product = A @ B
    if product.dtype.kind == "i" and np.abs(A.astype(float) @ B).max() > LARGEST_INTEGER:
        raise ScriptError(f"integer overflow: {shown(a)} * {shown(b)}", (a, b))
    return as_lists(product)


def as_lists(array: np.ndarray) -> Value:
    """As a program has it."""
    return tuple(map(tuple, array.tolist())) if array.ndim == 2 else tuple(array.tolist())


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
    "-": lambda value: BINARY["*"](-1, value),
    "+": lambda value: BINARY["*"](1, value),
    "not": lambda value: not truth(value),
    "!": lambda value: not truth(value),
}
"""Operators before a value."""
