"""The flange's pose at each shot, from a table as people write it.

One row a shot, with a header that names the columns. Separated by commas, semicolons, tabs or
spaces; blank lines and comments are passed over. Position `x y z` and one of

| rotation | columns |
|---|---|
| rotation vector | `rx ry rz` |
| unit quaternion | `qx qy qz qw`, in any order |
| angles about the base's fixed x, y and z, as ROS has them | `roll pitch yaw` |
| matrix | `r11 r12 ... r33` beside `x y z`, or `m11 m12 ... m34` with the position in it |

A unit follows its name (`x_mm`, `x [mm]`, `rx_deg`); without one they are metres and radians.
"""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.geometry import se3

POSES_FILE = "poses.csv"
HEADER = "name, x_m, y_m, z_m, rx_rad, ry_rad, rz_rad"
FARTHEST, NEAREST = 5.0, 0.02
"""No flange is farther from its base, nor are all of its poses nearer to it [m]."""
SMALLEST_TURN = np.radians(6.3)
"""Of the poses' rotations: what is smaller in degrees was radians [rad]."""
NOT_UNIT = 0.02
"""By which a quaternion or a rotation matrix may differ from one [-]."""
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "rad": 1.0, "deg": np.pi / 180, "": 1.0}
NAME_COLUMNS = ("name", "shot", "image", "picture", "file", "pose", "id", "index")
PREFIXES = {
    "": ("", "p", "pos", "position", "t", "trans", "translation"),
    "r": ("r", "rot", "rotvec", "rvec", "rotation"),
    "q": ("q", "quat", "quaternion", "orientation"),
}
"""What stands before x, y, z (and w) in a column's name."""
CELL = r"[rm]_?\d\d"
WITH_UNIT = r"(.+?)(?:[ _.]+[\[(]?|[\[(])(mm|cm|m|rad|deg)(?:rees|ians)?[\])]?"
Values = Float[np.ndarray, "n k"]
Rotations = Float[np.ndarray, "n 3 3"]


def _from_vectors(values: Values) -> Rotations:
    return Rotation.from_rotvec(values).as_matrix()


def _from_angles(values: Values) -> Rotations:
    return Rotation.from_euler("xyz", values).as_matrix()


def _from_quaternions(values: Values) -> Rotations:
    return Rotation.from_quat(values).as_matrix()


def _from_matrices(values: Values) -> Rotations:
    U, _, Vt = np.linalg.svd(values.reshape(-1, 3, 3))
    return U @ Vt


@dataclass(frozen=True, kw_only=True)
class Writing:
    """A way in which rotations are written, and what it is mistaken for."""

    columns: tuple[str, ...]
    read: Callable[[Values], Rotations]
    others: dict[str, Callable[[Values], Rotations]]


MATRIX = tuple(f"m{row}{column}" for row in "123" for column in "123")
WRITINGS = (
    Writing(
        columns=("rx", "ry", "rz"),
        read=_from_vectors,
        others={
            "angles about fixed axes, roll pitch yaw": _from_angles,
            "angles about fixed axes, yaw pitch roll": lambda v: _from_angles(v[:, ::-1]),
            "rx_deg ry_deg rz_deg": lambda v: _from_vectors(np.radians(v)),
        },
    ),
    Writing(
        columns=("qx", "qy", "qz", "qw"),
        read=_from_quaternions,
        others={"qw qx qy qz": lambda v: _from_quaternions(np.roll(v, -1, axis=1))},
    ),
    Writing(
        columns=("roll", "pitch", "yaw"), read=_from_angles, others={"rx ry rz": _from_vectors}
    ),
    Writing(
        columns=MATRIX,
        read=_from_matrices,
        others={"the transposed matrix": lambda v: _from_matrices(v).swapaxes(1, 2)},
    ),
)


@dataclass(frozen=True, kw_only=True)
class StatedPoses:
    """Poses by the names of their shots."""

    rows: dict[str, int]
    X_BF: Float[np.ndarray, "n 4 4"]
    """As written [m]."""
    readings: dict[str, Float[np.ndarray, "n 4 4"]]
    """What the same numbers were, had they been written in other ways [m]."""

    def __contains__(self, shot: str) -> bool:
        return _key(shot) in self.rows

    def row_of(self, shot: str) -> int:
        """Of a shot by its name: `07`, `7`, `07_left.png` and `07.png` are one."""
        return self.rows[_key(shot)]


def read(folder: Path) -> StatedPoses:
    """The table `poses.csv` of a folder.

    Raises:
        CalibrationError: It is missing, lacks columns, holds what is no number or no rotation,
            names a shot twice, or its numbers are of another unit than it says.
    """
    path = folder / POSES_FILE
    if not path.is_file():
        raise CalibrationError(
            f"no {POSES_FILE} in {folder}: hand-eye calibration needs the flange's pose at each "
            f"shot, in the columns {HEADER}",
            path,
        )
    numbers, header, fields = _fields_of(path)
    columns = _columns(path, header)
    rows: dict[str, int] = {}
    for row, number in enumerate(numbers):
        key = _key(fields[row][columns["name"][0]])
        if key in rows:
            raise _damaged(path, f"lines {numbers[rows[key]]} and {number} are both of shot {key}")
        rows[key] = row
    writing = next((w for w in WRITINGS if columns.keys() >= set(w.columns)), None)
    position = ("m14", "m24", "m34") if "m14" in columns else ("x", "y", "z")
    if writing is None or not columns.keys() >= set(position):
        raise _damaged(path, f"it has the columns {', '.join(header)}")
    decimal_comma = all("." not in field for row in fields for field in row[1:])

    def values(names: Sequence[str]) -> Values:
        """Numbers of some columns, in metres and radians."""
        return np.array([
            [scale * _number(path, numbers[row], field[at], decimal_comma)
             for at, scale in map(columns.__getitem__, names)]
            for row, field in enumerate(fields)
        ])  # fmt: skip

    p, turned = values(position), values(writing.columns)
    _require_lengths(path, p, columns[position[0]][1])
    _require_rotations(path, writing, turned, columns[writing.columns[0]][1])
    return StatedPoses(
        rows=rows,
        X_BF=se3.pose(writing.read(turned), p),
        readings={name: se3.pose(other(turned), p) for name, other in writing.others.items()},
    )


def _fields_of(path: Path) -> tuple[list[int], list[str], list[list[str]]]:
    """Line numbers, header and rows of a table, whatever separates its fields."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise _damaged(path, f"it cannot be read ({error})") from error
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line.strip(",;\t ")]
    if not lines:
        raise _damaged(path, "it is empty")
    heading = lines[0][1].lstrip("# ")
    separator = next((mark for mark in (";", "\t", ",") if mark in heading), " ")
    rows = [
        (number, [field.strip() for field in _split(line, separator)])
        for number, line in lines[1:]
        if not line.startswith("#")
    ]
    header = [field.strip().lower() for field in _split(heading, separator)]
    if not rows:
        raise _damaged(path, "it holds no row")
    for number, fields in rows:
        if len(fields) != len(header):
            raise _damaged(
                path, f"line {number} has {len(fields)} fields, the header names {len(header)}"
            )
    return [number for number, _ in rows], header, [fields for _, fields in rows]


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return line.split(separator)


def _columns(path: Path, header: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Where each column stands by its name here, and its unit [m, rad]."""
    columns = {}
    zero_based = any(re.fullmatch(r"[rm]_?(0\d|\d0)", name) for name in header)
    for at, name in enumerate(header):
        with_unit = re.fullmatch(WITH_UNIT, name)
        word, unit = with_unit.groups() if with_unit else (name, "")
        known = _known(word, zero_based)
        if known in columns:
            raise _damaged(path, f"its header names {known} twice")
        if known:
            columns[known] = at, UNITS[unit]
    if "name" not in columns:
        raise _damaged(path, f"its header, {', '.join(header)}, names no column `name`")
    return columns


def _known(word: str, zero_based: bool) -> str | None:
    """A column's name as it is called here, or None for what is of no use."""
    word = word.strip(" _.\"'")
    if word in NAME_COLUMNS:
        return "name"
    if word in ("roll", "pitch", "yaw"):
        return word
    if re.fullmatch(CELL, word):
        return "m" + "".join(str(int(digit) + zero_based) for digit in word[-2:])
    for kind, prefixes in PREFIXES.items():
        if word[-1:] in "xyzw" and word[:-1].rstrip("_.") in prefixes:
            return kind + word[-1:]
    return None


def _number(path: Path, line: int, field: str, decimal_comma: bool) -> float:
    try:
        value = float(field.replace(",", ".") if decimal_comma else field)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _damaged(path, f"line {line} holds {field!r} where a number was expected")
    return value


def _require_lengths(path: Path, p: Float[np.ndarray, "n 3"], unit: float) -> None:
    """Pass when positions may be a flange's, in the unit that they are said to have."""
    farthest = float(np.linalg.norm(p, axis=1).max())
    if farthest > FARTHEST:
        raise _damaged(
            path,
            f"the flange is said to be {farthest:.4g} m from its base: if these are millimetres, "
            "name the columns x_mm, y_mm, z_mm",
        )
    if unit < 1.0 and farthest < NEAREST:
        raise _damaged(
            path,
            f"the flange is said to stay within {farthest * 1e3:.2g} mm of its base: if these are "
            "metres, name the columns x_m, y_m, z_m",
        )


def _require_rotations(path: Path, writing: Writing, values: Values, unit: float) -> None:
    """Pass when the numbers are of rotations, in the unit that they are said to have."""
    if len(writing.columns) == 3:
        largest = float(np.abs(values).max())
        if np.linalg.norm(values, axis=1).max() > 2 * np.pi + 1e-3:
            raise _damaged(
                path,
                f"a rotation of {largest:.4g} rad is said: if these are degrees, name the columns "
                + ", ".join(f"{name}_deg" for name in writing.columns),
            )
        if unit < 1.0 and largest < SMALLEST_TURN:
            raise _damaged(
                path,
                f"no rotation exceeds {np.degrees(largest):.2g} degrees: if these are radians, "
                "name the columns " + ", ".join(f"{name}_rad" for name in writing.columns),
            )
        return
    size = 4 if writing.columns[0] == "qx" else 9
    if size == 4:
        wrong = np.abs(np.linalg.norm(values, axis=1) - 1)
    else:
        R = values.reshape(-1, 3, 3)
        wrong = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
        wrong[np.linalg.det(R) < 0] = 2.0
    if wrong.max() > NOT_UNIT:
        raise _damaged(
            path, f"row {int(wrong.argmax()) + 1} holds no rotation, {', '.join(writing.columns)}"
        )


def _key(name: str) -> str:
    """A shot's name without folder, suffix, side and leading zeros."""
    stem = re.sub(r"\.(png|jpe?g|tiff?|bmp)$", "", name.strip("\"' ").split("/")[-1].lower())
    stem = re.sub(r"[_-](left|right|l|r)$", "", stem)
    return stem.lstrip("0") or "0" if stem.isdigit() else stem


def _damaged(path: Path, what: str) -> CalibrationError:
    return CalibrationError(f"{path}: {what}. Expected one row a shot: {HEADER}", path)
