"""Which tool's a rig file is, and what it says."""

from collections.abc import Sequence
from pathlib import Path

from breastscan.errors import CalibrationError
from breastscan.vision.rigs import kalibr, matlab, middlebury, opencv, ros
from breastscan.vision.rigs.found import FoundRig
from breastscan.vision.rigs.trees import not_a_rig, read_tree

READERS = (kalibr, matlab, middlebury, ros, opencv)
"""Each has `TOOL`, its name, and `read`, which gives None of another tool's files. OpenCV's, which
knows files by the names of matrices, comes last."""


def read(paths: Sequence[Path]) -> FoundRig:
    """What one file, or a pair of files, says of a rig.

    Raises:
        CalibrationError: A file is missing, none of a tool that is known, or lacks something.
    """
    if not paths:
        raise CalibrationError("no rig file given: expected one, or two of a pair", paths)
    first = paths[0]
    trees = [read_tree(path) for path in (*paths, *_beside(paths))]
    for reader in READERS:
        try:
            found = reader.read(trees)
        except ValueError as error:
            raise not_a_rig(first, str(error)) from error
        if found is not None:
            return found
    names = sorted({name for tree in trees for name in tree})[:8]
    raise not_a_rig(
        first, f"no camera_matrix_left, nor what another tool calls it, among {', '.join(names)}"
    )


def _beside(paths: Sequence[Path]) -> list[Path]:
    """The right camera's file where the left one's alone was given, and so named."""
    if len(paths) != 1 or "left" not in paths[0].name:
        return []
    other = paths[0].with_name(paths[0].name.replace("left", "right"))
    return [other] if other.is_file() else []
