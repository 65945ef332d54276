"""Clouds and meshes on disk, in the formats that people have, as they stand in the file: in
whatever unit and frame, and with normals or without.
"""

import io
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from breastscan.errors import ConfigError
from breastscan.run import pcd, ply

DAMAGED = (
    ValueError, LookupError, TypeError, AttributeError, AssertionError, ArithmeticError,
    NotImplementedError, ImportError, OSError, struct.error,
)  # fmt: skip
"""What trimesh's readers raise of files that are damaged, or that need more files."""
PLACE = ("x", "y", "z")
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
"""Names of a normal's coordinates in PLY and text, and in PCD."""
CORNERS = ("vertex_indices", "vertex_index")
"""Names of a face's list in PLY."""
SEPARATORS = str.maketrans(",;\t", "   ")
DECIMAL_COMMA = re.compile(r"\s*(-?\d+,\d+(e[-+]?\d+)?[\s;]+){2}", re.IGNORECASE)
"""How a text begins whose numbers have commas for points."""
NUMBER = re.compile(r"[-+]?(\.?\d|nan\b|inf\b)", re.IGNORECASE)
COMMENTS = ("#", "//")
LISTED = 60
"""Characters of a line that an error shows."""
UNIT_TOLERANCE = 0.02
"""How far the length of a normal may be from 1 in a text, whose columns have no names."""
MOSTLY = 0.9
"""Share of a text's normals that must be that near [-]: some rows may hold none."""
VIEWPOINT = (
    "The file tells a viewpoint (VIEWPOINT), which is not applied: its points are taken to be in "
    "the robot's base frame as they stand."
)


@dataclass(frozen=True, kw_only=True)
class PointFile:
    """What a file holds of a surface."""

    points: Float[np.ndarray, "n 3"]
    """Points of a cloud or corners of a mesh, not always finite."""
    normals: Float[np.ndarray, "n 3"] | None = None
    """Of a cloud, of any length; None where the file has none."""
    triangles: Int[np.ndarray, "t 3"] | None = None
    """Corners of a mesh's faces by number, outwards counter-clockwise if they say anything; None
    for a cloud."""
    told: tuple[str, ...] = ()
    """What a user must know of how it was read."""


def read_cloud(source: Path) -> PointFile:
    """A cloud or a mesh, by the file's suffix.

    Raises:
        ConfigError: There is no such file, its format is not known, it is damaged, or empty.
    """
    if not source.is_file():
        there = "is a folder" if source.is_dir() else "there is no such file"
        raise ConfigError(
            f"no file at {source} ({there}): expected a cloud or a mesh ({KNOWN}), or a path (CSV "
            "with the columns x_m y_m z_m nx ny nz)",
            source,
        )
    reader = READERS.get(source.suffix.lower())
    if reader is None:
        raise ConfigError(
            f"{source} is of no format that is known here: save it as one of {KNOWN}", source
        )
    try:
        found = reader(source)
    except DAMAGED as error:
        raise ConfigError(
            f"{source} cannot be read as a cloud or a mesh ({error}): save it anew, whole",
            source,
        ) from error
    if not len(found.points):
        raise ConfigError(
            f"{source} holds no points that can be read: expected a cloud, or a mesh with faces; "
            "save it anew, whole",
            source,
        )
    return found


def is_path(source: Path) -> bool:
    """Whether a file is a path, as a scan leaves it, and no cloud: a CSV whose first line holds
    neither numbers nor x y z.
    """
    if source.suffix.lower() != ".csv":
        return False
    if not source.is_file():
        return True
    with source.open(encoding="utf-8", errors="replace") as stream:
        first = next((line for line in stream if line.strip()), "")
    return NUMBER.match(first.strip()) is None and not _names(first)


def _ply(source: Path) -> PointFile:
    elements = ply.elements_in(source.read_bytes())
    found = _named(elements.get("vertex", {}))
    corners = [faces for name, faces in elements.get("face", {}).items() if name in CORNERS]
    if not corners or not len(corners[0]):
        return found
    return PointFile(points=found.points, triangles=_triangles(corners[0], len(found.points)))


def _pcd(source: Path) -> PointFile:
    fields, has_viewpoint = pcd.fields_in(source.read_bytes())
    found = _named(fields)
    told = (VIEWPOINT,) if has_viewpoint else ()
    return PointFile(points=found.points, normals=found.normals, told=told)


def _named(columns: dict) -> PointFile:
    """A cloud whose coordinates are told by name."""
    lower = {name.lower(): values for name, values in columns.items()}
    if not set(PLACE) <= set(lower):
        raise ValueError(f"it holds no points x y z, but {' '.join(columns) or 'nothing'}")
    normals = [_columns(lower, names) for names in NORMALS if set(names) <= set(lower)]
    return PointFile(points=_columns(lower, PLACE), normals=normals[0] if normals else None)


def _columns(columns: dict, names: tuple[str, ...]) -> Float[np.ndarray, "n 3"]:
    return np.stack([np.asarray(columns[name], float) for name in names], axis=1)


def _triangles(faces: list[np.ndarray] | np.ndarray, points: int) -> Int[np.ndarray, "t 3"]:
    """Faces of any number of corners, cut from their first corner."""
    groups = [np.asarray(faces, int)] if isinstance(faces, np.ndarray) else []
    if not groups:
        sizes = np.array([len(face) for face in faces])
        groups = [
            np.array([faces[k] for k in np.flatnonzero(sizes == size)], int)
            for size in np.unique(sizes)
        ]
    cut = [group[:, [0, k, k + 1]] for group in groups for k in range(1, group.shape[1] - 1)]
    found = np.concatenate([np.zeros((0, 3), int), *cut])
    if found.size and not 0 <= found.min() <= found.max() < points:
        raise ValueError(f"its faces name points that it has not, of {points}")
    return found


def _mesh(source: Path) -> PointFile:
    """What trimesh reads, all parts of it in their places."""
    with io.BytesIO(source.read_bytes()) as stream:
        scene = trimesh.load_scene(stream, file_type=source.suffix[1:].lower(), process=False)
    points, triangles = [np.zeros((0, 3))], [np.zeros((0, 3), int)]
    first = 0
    for part in scene.dump():
        points.append(np.asarray(getattr(part, "vertices", points[0]), float))
        triangles.append(first + np.asarray(getattr(part, "faces", triangles[0])))
        first += len(points[-1])
    faces = np.concatenate(triangles)
    return PointFile(points=np.concatenate(points), triangles=faces if len(faces) else None)


def _text(source: Path) -> PointFile:
    """Rows of numbers: a place, then whatever; the first three columns after it that have the
    length 1 are the normal, unless a line of names says what is what.
    """
    text = source.read_text(encoding="utf-8", errors="replace").lstrip("\ufeff")
    lines = [line for line in text.splitlines() if line.strip()]
    names = _names(lines[0]) if lines else []
    rows = [line for line in lines if not line.lstrip().startswith(COMMENTS)]
    if rows and rows[0].strip().isdigit():
        rows = rows[1:]  # their number, in PTS files
    if rows and NUMBER.match(rows[0].strip()) is None:
        if not names:
            raise ValueError(f"its first line, {rows[0][:LISTED]!r}, names no columns x y z")
        rows = rows[1:]
    if not rows:
        return PointFile(points=np.zeros((0, 3)))
    if DECIMAL_COMMA.match(rows[0]):
        rows = [row.replace(",", ".") for row in rows]
    values = np.loadtxt([row.translate(SEPARATORS) for row in rows], ndmin=2)
    if len(names) == values.shape[1]:
        return _named(dict(zip(names, values.T, strict=True)))
    if values.shape[1] < len(PLACE):
        raise ValueError(f"its rows hold {values.shape[1]} numbers, a place takes 3")
    for first in range(3, values.shape[1] - 2):
        normals = values[:, first : first + 3]
        off = np.abs(np.linalg.norm(normals, axis=1) - 1.0)
        if np.mean(off < UNIT_TOLERANCE) > MOSTLY:
            return PointFile(points=values[:, :3], normals=normals)
    return PointFile(points=values[:, :3])


def _names(first: str) -> list[str]:
    """Columns by name, if the first line tells them, also as a comment."""
    words = first.lower().lstrip("#/ \t\ufeff").translate(SEPARATORS).replace('"', " ").split()
    return words if set(PLACE) <= set(words) else []


READERS: dict[str, Callable[[Path], PointFile]] = {
    ".ply": _ply,
    ".pcd": _pcd,
    **dict.fromkeys((".xyz", ".txt", ".pts", ".asc", ".csv"), _text),
    **dict.fromkeys((".obj", ".stl", ".glb"), _mesh),
}
"""What reads a file, by its suffix."""
KNOWN = ", ".join(suffix[1:].upper() for suffix in READERS)
