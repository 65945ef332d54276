"""What stated poses may be that fit no shots: the usual mistakes, each undone and tried."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.vision.board import Board, BoardShot
from breastscan.vision.boards.arm_loop import most_agreed
from breastscan.vision.camera import StereoRig

SHARE = 0.8
"""Of the poses that must fit once a mistake is undone [-]."""
SHIFTS = (1, -1, 2, -2)
"""Rows by which poses and shots may have slipped."""
Poses = Float[np.ndarray, "n 4 4"]
INVERTED = (
    "they fit when inverted: either the base is given in the flange where the flange in the base "
    "is meant, or it is the cameras that ride on the flange and the board that stands still; "
    "exactly one of both is answered by --on-flange"
)


def named(
    shots: Sequence[BoardShot],
    X_BF: Poses,
    rig: StereoRig,
    board: Board,
    readings: Mapping[str, Poses],
) -> str | None:
    """What is wrong with poses that do not fit, or None where nothing of the table mends it.

    Args:
        shots: The board's corners.
        X_BF: The poses as read.
        rig: The calibrated cameras.
        board: The board.
        readings: The same numbers, read in another of the ways in which poses are written.
    """
    for name, some, poses in _mended(X_BF, readings):
        if most_agreed([shots[k] for k in some], poses, rig, board).share >= SHARE:
            return name
    return None


def _mended(
    X_BF: Poses, readings: Mapping[str, Poses]
) -> Iterator[tuple[str, Sequence[int], Poses]]:
    """Of each mistake: its name, the shots that remain, and their poses once it is undone."""
    every = range(len(X_BF))
    for name, poses in readings.items():
        yield f"they fit when read as {name}: name the columns so", every, poses
    yield INVERTED, every, se3.inverse(X_BF)
    for rows in SHIFTS:
        some = [k for k in every if k + rows in every]
        which = "after" if rows > 0 else "before"
        yield (
            f"each shot fits the pose {abs(rows)} row{'s' * (abs(rows) > 1)} {which} its own: the "
            "rows have slipped against the pictures",
            some,
            X_BF[[k + rows for k in some]],
        )
