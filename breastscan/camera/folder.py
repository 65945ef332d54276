"""Stereo pairs on disk, as a camera."""

import re
from pathlib import Path

from breastscan.camera.grey import SUFFIXES, read_grey
from breastscan.camera.interface import StereoPair
from breastscan.camera.pairs import paired
from breastscan.errors import PerceptionError

SECONDS = re.compile(r"\d+\.\d+")
"""A time in a file's name [s], as in left_12.480.png."""


class FolderCamera:
    """Implements `breastscan.robot.interface.StereoCamera` on a folder: each `capture` gives the
    next pair.

    Two files are a pair as `pairs.paired` has it. A decimal number in the name is the pair's time
    in seconds; where there is none, it is the time at which the left file was last changed. Pairs
    come in the order of their times.
    """

    def __init__(self, folder: Path) -> None:
        """Look what is there.

        Raises:
            PerceptionError: The folder holds no pair, or a picture without its partner.
        """
        self._folder = folder
        found = paired(folder)
        if found.alone:
            raise PerceptionError(
                f"{found.alone[0]} has no partner: expected a file of the same name with the other "
                "side's word",
                found.alone,
            )
        if not found.pairs:
            raise PerceptionError(
                f"no pairs in {folder}: expected pictures ({', '.join(SUFFIXES)}) with left and "
                "right in their names",
                folder,
            )
        self._pairs = sorted((_time(left), left, right) for left, right in found.pairs.values())
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


def _time(path: Path) -> float:
    stated = SECONDS.search(path.stem)
    return float(stated.group()) if stated else path.stat().st_mtime
