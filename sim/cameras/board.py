# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The twin on calibration day: no breast, but a chessboard, placed freely or held by the flange."""

import cv2
import mujoco
import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3
from breastscan.vision.board import Board
from breastscan.vision.camera import Intrinsics, StereoRig
from sim.rig_errors import rig_errors
from sim.room.describe import Element, add_material, add_visual, placed
from sim.room.shapes import along, barrel, joined
from sim.scene import Scene, SceneConfig

MARGIN_SQUARES = 1
"""Width of the white rim around the squares [squares]."""
BACKING = 0.004
"""Thickness of the plate behind the print [m]."""
ROD_RADIUS = 0.008
"""[m]"""
X_FBoard = se3.pose(np.eye(3), np.array([-0.275, -0.05, 0.12]))
"""The held board in the flange: beside the probe, its face rotated back along the arm, up when the
flange looks down."""
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Successive multiples of this spread evenly over the circle [rad]."""
COLOURS = {
    "board_black": (0.06, 0.06, 0.06, 1.0),
    "board_white": (0.66, 0.66, 0.66, 1.0),
    "board_back": (0.40, 0.40, 0.42, 1.0),
}


class BoardScene(Scene):
    """A scene with a board in it, for `sim.cameras.camera.SimStereoCamera` to see.

    A board's frame has its origin in the first inner corner, x along a row of corners, y along a
    column and z into the board, away from who looks at it.
    """

    def __init__(self, config: SceneConfig, board: Board, *, held: bool) -> None:
        """Describe it.

        Args:
            config: Cameras, their noise, and everything else that stands around.
            board: The board.
            held: Whether the flange holds the board at `X_FBoard`; else `place_board` says where it
                floats.
        """
        super().__init__(config)
        self._board = board
        self._held = held

    def place_board(self, X_BBoard: Float[np.ndarray, "4 4"]) -> None:
        """Float the board at this pose from the next picture on."""
        body = self.pictures.body("board")
        body.pos, body.quat = (
            X_BBoard[:3, 3],
            Rotation.from_matrix(X_BBoard[:3, :3]).as_quat(scalar_first=True),
        )

    def errors_of(self, rig: StereoRig) -> dict[str, float]:
        """How far an estimated rig is from the scene's own."""
        return rig_errors(rig, self.rig)

    def _describe(self, *, with_skin: bool) -> Element:
        root = super()._describe(with_skin=False)
        if with_skin:
            # who calibrates keeps shadow edges off the board
            root.find("light", "key").castshadow = False
            parent = root.find("body", "flange") if self._held else root.worldbody
            _add_board(parent, self._board, held=self._held)
        return root

    def _add_skin(self, spec: mujoco.MjSpec) -> None:
        """None: the board is there in its place."""


def _add_board(parent: Element, board: Board, *, held: bool) -> None:
    for name, rgba in COLOURS.items():
        add_material(parent.root, name, rgba)
    body = parent.add("body", name="board", **placed(X_FBoard))
    cells = _cells(board)
    for colour, black in (("board_black", True), ("board_white", False)):
        add_visual(
            body,
            colour,
            _print(board, [cell for cell, is_black in cells.items() if is_black == black]),
            colour,
        )
    add_visual(body, "board_back", _backing(board), "board_back")
    if held:
        add_visual(body, "board_bracket", _bracket(board), "board_back")


def _cells(board: Board) -> dict[tuple[int, int], bool]:
    """Column and row of every square of print and rim, counted from the first inner corner, and
    whether it is black.
    """
    columns = range(-1 - MARGIN_SQUARES, board.columns + MARGIN_SQUARES)
    rows = range(-1 - MARGIN_SQUARES, board.rows + MARGIN_SQUARES)
    return {
        (column, row): -1 <= column < board.columns
        and -1 <= row < board.rows
        and (column + row) % 2 == 0
        for column in columns
        for row in rows
    }


def _print(board: Board, cells: list[tuple[int, int]]) -> trimesh.Trimesh:
    """Flat squares that share their corners: neighbours of both colours leave neither gap nor
    overlap.
    """
    corners = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    flat = board.square * (np.array(cells)[:, None] + corners).reshape(-1, 2)
    triangles = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(cells))[:, None, None]
    return trimesh.Trimesh(
        np.column_stack([flat, np.zeros(len(flat))]), triangles.reshape(-1, 3), process=False
    )


def _backing(board: Board) -> trimesh.Trimesh:
    """A plate behind the print."""
    size = board.square * (np.array([board.columns, board.rows]) + 1 + 2 * MARGIN_SQUARES)
    centre = (*board.centre[:2], BACKING / 2 + 1e-3)
    return trimesh.creation.box((*size, BACKING), se3.pose(np.eye(3), np.array(centre)))


def _bracket(board: Board) -> trimesh.Trimesh:
    """A rod behind the centre of the board, and a post from it back to the flange."""
    x, y, _ = board.centre
    axis_x, behind = -X_FBoard[0, 3], BACKING + ROD_RADIUS
    rod = along(barrel(ROD_RADIUS, axis_x - x, 0.001), (1.0, 0.0, 0.0), (x, y, behind))
    post = along(
        barrel(ROD_RADIUS, X_FBoard[2, 3] + behind, 0.001), (0.0, 0.0, -1.0), (axis_x, y, behind)
    )
    return joined(rod, post)


def tilted(
    number: int, tilt_deg: tuple[float, float], rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """A tilt about an axis that goes round from shot to shot, after a small rotation about the
    line of sight.
    """
    axis = number * GOLDEN_ANGLE
    tilt = np.radians(rng.uniform(*tilt_deg)) * np.array([np.cos(axis), np.sin(axis), 0.0])
    roll = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)])
    return se3.from_rotation_vector(tilt, np.zeros(3)) @ se3.from_rotation_vector(roll, np.zeros(3))


def centred(board: Board) -> Float[np.ndarray, "4 4"]:
    """The board in a frame at its centre."""
    return se3.pose(np.eye(3), -board.centre)


def seen_by_both(rig: StereoRig, X_LBoard: Float[np.ndarray, "4 4"], board: Board) -> bool:
    """Whether the whole board, its white rim included, is in both images."""
    return _seen(rig.left, X_LBoard, board) and _seen(rig.right, rig.X_RL @ X_LBoard, board)


def _seen(camera: Intrinsics, X_CBoard: Float[np.ndarray, "4 4"], board: Board) -> bool:
    reach = 1 + MARGIN_SQUARES
    x, y = np.meshgrid([-reach, board.columns - 1 + reach], [-reach, board.rows - 1 + reach])
    rim = board.square * np.stack([x.ravel(), y.ravel(), np.zeros(4)], axis=1)
    rotation = se3.rotation_vector(X_CBoard)
    pixels = cv2.projectPoints(rim, rotation, X_CBoard[:3, 3], camera.K, camera.distortion)[0][:, 0]
    return bool(((pixels > 0) & (pixels < (camera.width - 1, camera.height - 1))).all())
