"""The calibration board: a plain chessboard, and its inner corners in pictures [Zhang, Sec.
II-A, Fig. 2].
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.errors import ConfigError

LARGEST_SQUARE = 0.5
"""Of a board [m]."""
COPIED_PX = 0.02
"""By which the corners of a copied picture differ at most; another one of the same board differs
more by its noise [px]."""
DETECTION = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
"""Search harder, and place the corners on an up-scaled picture."""


@dataclass(frozen=True, kw_only=True)
class Board:
    """A chessboard, by the corners inside it where four squares meet.

    Its frame has the origin in the first inner corner, x along a row of corners, y along a column
    and z into the board. A board of even by even, or of odd by odd, squares looks the same after
    half a rotation: which of its two ends comes first is not seen in one picture.
    """

    columns: int = 7
    """Inner corners in a row [-]."""
    rows: int = 5
    """Inner corners in a column [-]."""
    square: float = 0.025
    """Side of a square [m]."""

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise ConfigError(
                "board.columns and board.rows must be 3 inner corners or more, got "
                f"{self.columns} x {self.rows}",
                self,
            )
        if not 0 < self.square <= LARGEST_SQUARE:
            raise ConfigError(
                f"board.square must be a length in metres, up to {LARGEST_SQUARE} m, got "
                f"{self.square:g} m: 20 mm are 0.02",
                self,
            )

    @property
    def turns(self) -> tuple[int, ...]:
        """By how many quarter turns it looks the same, colours and all."""
        if (self.columns + self.rows) % 2:
            return (0,)
        if self.columns == self.rows and self.columns % 2 == 0:
            return (0, 1, 2, 3)
        return (0, 2)

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """The inner corners in the board's frame, row by row [m]."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """The centre of the inner corners in the board's frame [m]."""
        return self.points.mean(axis=0)


def find_corners(image: UInt8[np.ndarray, "h w"], board: Board) -> Float[np.ndarray, "n 2"] | None:
    """Pixels of the inner corners, row by row, or None where the whole board is not seen."""
    found, corners = cv2.findChessboardCornersSB(
        image, (board.columns, board.rows), flags=DETECTION
    )
    return corners[:, 0].astype(float) if found else None


@dataclass(frozen=True, kw_only=True)
class BoardShot:
    """One shot of the board by both cameras; the same row of both arrays is the same corner."""

    name: str
    left: Float[np.ndarray, "n 2"]
    """Corners in the left picture [px]."""
    right: Float[np.ndarray, "n 2"]
    """Corners in the right picture [px]."""

    def is_like(self, other: "BoardShot") -> bool:
        """Whether another shot shows the same: a picture that was copied, not one taken again."""
        apart = np.abs([self.left - other.left, self.right - other.right])
        return float(apart.max()) < COPIED_PX

    def half_turned(self) -> "BoardShot":
        """The same shot, its corners counted from the board's other end."""
        return BoardShot(name=self.name, left=self.left[::-1], right=self.right[::-1])


def find_shot(
    name: str, left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h w"], board: Board
) -> BoardShot | None:
    """The corners in both pictures of a pair, or None where one of them does not show the whole
    board.

    The detector counts the corners of a board whose ends differ from the same one. Of one that
    looks the same turned, the order in the right picture is chosen to run as in the left one: the
    cameras of a rig are rolled about alike.
    """
    on_left, on_right = find_corners(left, board), find_corners(right, board)
    if on_left is None or on_right is None:
        return None
    grid = on_right.reshape(board.rows, board.columns, 2)
    orders = [np.rot90(grid, turns).reshape(-1, 2) for turns in board.turns]
    return BoardShot(name=name, left=on_left, right=min(orders, key=lambda o: _rolled(on_left, o)))


def _rolled(on_left: Float[np.ndarray, "n 2"], on_right: Float[np.ndarray, "n 2"]) -> float:
    """By how much the ways from the first corner to the last differ in direction [rad]."""
    ways = [corners[-1] - corners[0] for corners in (on_left, on_right)]
    return float(abs(np.angle(complex(*ways[0]) / complex(*ways[1]))))
