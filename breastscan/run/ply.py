"""PLY files in all their forms: ASCII, or binary in either order of bytes; elements in any order,
with properties in any order, lists among them. [Turk]
"""

import re
from dataclasses import dataclass

import numpy as np

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"), **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"), **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"), **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"), **dict.fromkeys(("double", "float64"), "f8"),
}  # fmt: skip
"""Names of numbers, and what NumPy calls them."""
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
END = re.compile(rb"end_header[ \t]*(\r\n|\n|\r)")
NUMBER = "f8"
"""What every number of an ASCII file is read as."""


@dataclass(frozen=True, kw_only=True)
class Element:
    """So many rows of the same properties."""

    name: str
    count: int
    properties: list[tuple[str, str, str]]
    """Name of each, type of its length, empty where it is no list, and type of its numbers."""


def elements_in(data: bytes) -> dict[str, dict[str, list[np.ndarray] | np.ndarray]]:
    """The properties of each element, one array each; of a list one array a row.

    Raises:
        ValueError: The bytes are no PLY file, or not a whole one.
    """
    end = END.search(data)
    if not data.startswith(b"ply") or end is None:
        raise ValueError("it does not begin with a header from 'ply' to 'end_header'")
    form, elements = _header(data[: end.start()].decode("ascii", "replace").splitlines())
    body = data[end.end() :]
    if form == "ascii":  # then it is read as if it were binary, all numbers alike
        body = np.array(body.split()).astype(NUMBER).tobytes()
    found, start = {}, 0
    for element in elements:
        found[element.name], start = _rows(element, body, start)
    if form == "ascii" and start < len(body):
        raise ValueError("it holds more numbers than its header tells")
    return found


def _header(lines: list[str]) -> tuple[str, list[Element]]:
    form, elements = "", []
    for words in map(str.split, lines):
        match words:
            case ["format", name, _] if name in ORDERS:
                form = name
            case ["element", name, count] if count.isdecimal():
                elements.append(Element(name=name, count=int(count), properties=[]))
            case ["property", "list", length, kind, name]:
                elements[-1].properties.append((name, _type(length, form), _type(kind, form)))
            case ["property", kind, name]:
                elements[-1].properties.append((name, "", _type(kind, form)))
            case ["ply"] | ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"its header holds the line {' '.join(words)!r}")
    if not form:
        raise ValueError("its header tells no format")
    return form, elements


def _type(name: str, form: str) -> str:
    if name not in TYPES:
        raise ValueError(f"its header names a type {name!r}")
    return ORDERS[form] + (NUMBER if form == "ascii" else TYPES[name])


def _rows(
    element: Element, body: bytes, start: int
) -> tuple[dict[str, list[np.ndarray] | np.ndarray], int]:
    """An element's properties, and where the next one's begin: at once where all its lists are as
    long as in the first row, which is usual, else row by row.
    """
    if not element.count:
        return {name: np.zeros(0) for name, _, _ in element.properties}, start
    first, _ = _row(element, body, start)
    fields = []
    for (name, length, kind), values in zip(element.properties, first, strict=True):
        if length:
            fields.append((f"length of {name}", length))
        fields.append((name, kind, (len(values),)) if length else (name, kind))
    end = start + np.dtype(fields).itemsize * element.count
    lists = [name for name, length, _ in element.properties if length]
    if end <= len(body) or not lists:
        _require_bytes(body, end, element)
        table = np.frombuffer(body, np.dtype(fields), element.count, start)
        if all(np.ptp(table[f"length of {name}"]) == 0 for name in lists):
            names = [name for name, _, _ in element.properties]
            return {name: table[name] for name in names}, end
    rows = []
    for _ in range(element.count):
        row, start = _row(element, body, start)
        rows.append(row)
    columns = zip(element.properties, zip(*rows, strict=True), strict=True)
    return {
        name: list(column) if length else np.concatenate(column)
        for (name, length, _), column in columns
    }, start


def _row(element: Element, body: bytes, start: int) -> tuple[list[np.ndarray], int]:
    """The values of each property of the row that begins there, and where the next one does."""
    values = []
    for _, length, kind in element.properties:
        count = 1
        if length:
            (count,), start = _numbers(body, length, 1, start, element)
            if count < 0:
                raise ValueError(f"a list of {element.name!r} has the length {count}")
        found, start = _numbers(body, kind, int(count), start, element)
        values.append(found)
    return values, start


def _numbers(
    body: bytes, kind: str, count: int, start: int, element: Element
) -> tuple[np.ndarray, int]:
    end = start + np.dtype(kind).itemsize * count
    _require_bytes(body, end, element)
    return np.frombuffer(body, kind, count, start), end


def _require_bytes(body: bytes, end: int, element: Element) -> None:
    if end > len(body):
        raise ValueError(f"it ends before the last of {element.count} rows of {element.name!r}")
