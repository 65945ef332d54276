"""Which pictures of a folder belong together, by their names as people give them."""

import re
from dataclasses import dataclass
from pathlib import Path

from breastscan.camera.grey import SUFFIXES
from breastscan.errors import PerceptionError

CONVENTIONS = (
    ("left", "right"),
    ("l", "r"),
    ("cam0", "cam1"),
    ("cam1", "cam2"),
    ("camera0", "camera1"),
    ("camera1", "camera2"),
    ("image_0", "image_1"),
    ("image_2", "image_3"),
    ("im0", "im1"),
    ("view1", "view5"),
)
"""What the left and the right picture of a pair are called, in a file's name or in its folder's."""
DEEPEST = 3
"""Folders below the one that is given, its own pictures included."""


@dataclass(frozen=True)
class Paired:
    """The pictures of a folder."""

    pairs: dict[str, tuple[Path, Path]]
    """Left and right, by the name that they have in common."""
    alone: tuple[Path, ...]
    """Those of one side without a partner."""


def paired(folder: Path) -> Paired:
    """The pairs of a folder: files, or folders, that differ in nothing but one side's word.

    left.png and right.png, left_007.png and right_007.png, NAME_left.tif and NAME_right.tif,
    left01.jpg and right01.jpg, 01_l.png and 01_r.png, left/01.png and right/01.png, cam0/data/T.png
    and cam1/data/T.png are pairs. Of several conventions the one that makes the most pairs holds.

    Raises:
        PerceptionError: There is no such folder.
    """
    if not folder.is_dir():
        raise PerceptionError(
            f"there is no folder {folder}: expected one with pairs of pictures", folder
        )
    pictures = sorted(
        path
        for depth in range(DEEPEST)
        for path in folder.glob("/".join(["*"] * (depth + 1)))
        if path.suffix.lower() in SUFFIXES and path.is_file()
    )
    return max(
        (_by(words, folder, pictures) for words in CONVENTIONS),
        key=lambda found: (len(found.pairs), len(found.alone)),
    )


def _by(words: tuple[str, str], folder: Path, pictures: list[Path]) -> Paired:
    """The pairs of one convention."""
    sides: dict[str, dict[str, Path]] = {word: {} for word in words}
    either = re.compile("|".join(_whole(word) for word in words))
    for path in pictures:
        name = str(path.relative_to(folder).with_suffix("")).lower()
        found = list(either.finditer(name))
        if found:  # the last, where its folder is called so as well
            begin, end = found[-1].span()
            sides[found[-1].group()][f"{name[:begin]}*{name[end:]}"] = path
    left, right = sides.values()
    common = sorted(left.keys() & right.keys())
    return Paired(
        pairs={_name(key): (left[key], right[key]) for key in common},
        alone=tuple(
            path
            for one, other in ((left, right), (right, left))
            for key, path in sorted(one.items())
            if key not in other
        ),
    )


def _whole(word: str) -> str:
    """A pattern for a word that is no part of a longer one, nor of a longer number."""
    return rf"(?<![a-z]){word}(?![{'0-9' if word[-1].isdigit() else 'a-z'}])"


def _name(key: str) -> str:
    """What a pair's pictures have in common, `*` standing for the side: `a/*_07` is `a_07`."""
    return re.sub(r"[/ _.-]*\*[/ _.-]*", "_", key).replace("/", "_").strip("_") or "pair"
