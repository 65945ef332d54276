"""Stereo pairs on disk, as a camera."""

import re
from pathlib import Path

from breastscan.camera.grey import SUFFIXES, read_grey
from breastscan.camera.interface import StereoPair
from breastscan.errors import PerceptionError

SIDES = ("left", "right")
SECONDS = re.compile(r"\d+\.\d+")
"""A time in a file's name [s], as in left_12.480.png."""


class FolderCamera:
    """Implements `breastscan.robot.interface.StereoCamera` on a folder: each `capture` gives the
    next pair.

    Two files are a pair if their names differ in nothing but `left` and `right`: left.png and
    right.png, left_007.png and right_007.png, NAME_left.tif and NAME_right.tif. A decimal number in
    the name is the pair's time in seconds; where there is none, it is the time at which the left
    file was last changed. Pairs come in the order of their times.
    """

    def __init__(self, folder: Path) -> None:
        """Look what is there.

        Raises:
            PerceptionError: The folder holds no pair, or a picture without its partner.
        """
        self._folder = folder
        files = {side: _files(folder, side) for side in SIDES}
        alone = {
            name: side
            for side, other in (SIDES, SIDES[::-1])
            for name in files[side].keys() - files[other]
        }
        if alone:
            name, side = min(alone.items())
            raise PerceptionError(
                f"{files[side][name]} has no partner: expected a file of the same name with "
                f"{' and '.join(SIDES)}",
                alone,
            )
        if not files["left"]:
            raise PerceptionError(
                f"no pairs in {folder}: expected pictures ({', '.join(SUFFIXES)}) with left and "
                "right in their names",
                folder,
            )
        pairs = [(_time(left), left, files["right"][name]) for name, left in files["left"].items()]
        self._pairs = sorted(pairs)
        self._next = 0

    def __len__(self) -> int:
        """Pairs in the folder."""
        return len(self._pairs)

    def capture(self) -> StereoPair:
        """The next pair.

        Raises:
            PerceptionError: All were taken, or a picture is damaged.
        """
        if self._next == len(self._pairs):
            raise PerceptionError(
                f"all {len(self)} pairs in {self._folder} were taken: put more there, or begin "
                "again",
                self._folder,
            )
        time, left, right = self._pairs[self._next]
        self._next += 1
        return StereoPair(left=read_grey(left), right=read_grey(right), time=time)


def _files(folder: Path, side: str) -> dict[str, Path]:
    """The pictures of one side, by what their names have in common with their partners'."""
    if not folder.is_dir():
        raise PerceptionError(
            f"there is no folder {folder}: expected one with pairs of pictures", folder
        )
    found = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in SUFFIXES and side in path.stem:
            found[path.stem.replace(side, "", 1)] = path
    return found


def _time(path: Path) -> float:
    stated = SECONDS.search(path.stem)
    return float(stated.group()) if stated else path.stat().st_mtime
