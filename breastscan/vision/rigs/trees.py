"""Rig files of any tool as plain names and numbers: YAML, JSON and XML as OpenCV and others write
them, NumPy's and MATLAB's arrays, and Middlebury's lines.

A matrix is an array here, whatever it was in the file; what it means, the readers beside this
module know.
"""

import gzip
import io
import json
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from breastscan.errors import CalibrationError

Tree = dict[str, Any]
"""Values by name: numbers, texts, arrays, trees."""
LARGEST = 10_000_000
"""Of a rig file [byte]: a megabyte would be much."""
NOT_FINITE = {".nan": np.nan, ".inf": np.inf, "+.inf": np.inf, "-.inf": -np.inf}
"""As OpenCV writes them."""
MATRIX = ("opencv-matrix", "opencv-nd-matrix")
MAT_AS_JSON = (
    "import io, json, sys; from scipy.io import loadmat; "
    "print(json.dumps(loadmat(io.BytesIO(sys.stdin.buffer.read()), simplify_cells=True), "
    "default=lambda v: v.tolist() if hasattr(v, 'tolist') else str(v)))"
)
MAT_TIME = 60.0
"""The longest that it may take [s]."""
LINE = re.compile(r"^\s*(\w+)\s*=\s*(.+?)\s*$")


def read_tree(path: Path) -> Tree:
    """What a file holds.

    Raises:
        CalibrationError: It is missing, far too large, or cannot be read.
    """
    if not path.is_file():
        raise CalibrationError(
            f"no rig file at {path}: give one with --rig, or calibrate first", path
        )
    if path.stat().st_size > LARGEST:
        raise not_a_rig(path, f"it has more than {LARGEST // 10**6} MB")
    suffixes = [suffix.lower() for suffix in path.suffixes] or [""]
    packed = suffixes[-1] == ".gz"
    suffix = suffixes[-2] if packed and len(suffixes) > 1 else suffixes[-1]
    try:
        data = gzip.decompress(path.read_bytes()) if packed else path.read_bytes()
        tree = _PARSERS.get(suffix, _text)(data)
    except Exception as error:  # five libraries' own, of bytes that may be anything
        raise not_a_rig(path, f"readers cannot parse it: {_line(error)}") from error
    if not isinstance(tree, dict):
        raise not_a_rig(path, "it holds no names")
    return {str(name): value for name, value in tree.items()}


def not_a_rig(path: Path, reason: str) -> CalibrationError:
    """The error to raise of a file that holds no rig."""
    return CalibrationError(
        f"{path} is not a rig file ({reason}): expected one of breastscan, OpenCV, ROS, Kalibr, "
        "MATLAB or Middlebury (docs/calibration.md)",
        path,
    )


def _line(error: Exception) -> str:
    """The first line of an error."""
    return (str(error).splitlines() or [type(error).__name__])[0]


class _Loader(yaml.SafeLoader):
    """YAML with OpenCV's matrices."""


def _yaml_matrix(loader: yaml.SafeLoader, node: yaml.Node) -> np.ndarray:
    if not isinstance(node, yaml.MappingNode):
        raise ValueError("a matrix is no mapping")
    return _matrix(loader.construct_mapping(node, deep=True))


for _name in MATRIX:
    _Loader.add_constructor(f"tag:yaml.org,2002:{_name}", _yaml_matrix)


def _matrix(values: Mapping[Any, Any]) -> np.ndarray:
    """OpenCV's matrix, a list of numbers with its size, as an array."""
    shape = values["sizes"] if "sizes" in values else [values["rows"], values["cols"]]
    return _numbers(values["data"]).reshape([int(size) for size in shape])


def _numbers(data: list) -> np.ndarray:
    known = [NOT_FINITE.get(v.lower(), v) if isinstance(v, str) else v for v in data]
    return np.array(known, float)


def _yaml(data: bytes) -> Any:
    text = data.decode("utf-8")
    if text.startswith("%YAML:"):  # OpenCV's first line is none of YAML's
        text = text.partition("\n")[2]
    return next(yaml.load_all(text, _Loader))  # a safe one; ROS ends each message with a mark


def _json(data: bytes) -> Any:
    def values(pairs: dict[str, Any]) -> Any:
        return _matrix(pairs) if pairs.get("type_id") in MATRIX else pairs

    return json.loads(data, object_hook=values)


def _xml(data: bytes) -> Tree:
    storage = cv2.FileStorage(data.decode("utf-8"), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    root = storage.root()
    tree = {name: _node(root.getNode(name)) for name in root.keys()}  # noqa: SIM118 (no dict)
    storage.release()
    return tree


def _node(node: cv2.FileNode) -> Any:
    if node.isMap():
        found = node.mat()
        if found is not None:
            return np.array(found, float)
        return {name: _node(node.getNode(name)) for name in node.keys()}  # noqa: SIM118
    if node.isSeq():
        return [_node(node.at(k)) for k in range(node.size())]
    if node.isInt():
        return int(node.real())
    return node.real() if node.isReal() else node.string()


def _npz(data: bytes) -> Tree:
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _mat(data: bytes) -> Any:
    """In a process of its own: of a damaged file SciPy's reader ends the process that it is in."""
    child = subprocess.run(
        [sys.executable, "-c", MAT_AS_JSON], input=data, capture_output=True, timeout=MAT_TIME
    )
    if b"NotImplementedError" in child.stderr:
        raise ValueError("it is of MATLAB's version 7.3: save it with save(..., '-v7')")
    if child.returncode != 0:
        raise ValueError("it is no MAT-file, or a damaged one")
    return json.loads(child.stdout)


def _text(data: bytes) -> Any:
    """Lines of names and values, as Middlebury has them, or YAML."""
    found = [LINE.match(line) for line in data.decode("utf-8").splitlines() if line.strip()]
    if found and all(found):
        return {line[1]: _value(line[2]) for line in found if line is not None}
    return _yaml(data)


def _value(text: str) -> Any:
    if text.startswith("["):
        return np.array([[float(v) for v in row.split()] for row in text.strip("[]").split(";")])
    return float(text)


_PARSERS: dict[str, Callable[[bytes], Any]] = {
    ".yaml": _yaml,
    ".yml": _yaml,
    ".json": _json,
    ".xml": _xml,
    ".npz": _npz,
    ".mat": _mat,
}
