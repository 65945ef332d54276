"""A board shown to the twin's cameras as a careful operator would.

It comes everywhere in both images, near, and tilted about changing axes: pictures to calibrate the
cameras from.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Float

from breastscan.camera.interface import StereoPair
from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.vision.board import Board
from breastscan.vision.camera import Intrinsics, StereoRig
from sim.cameras.board import BoardScene, centred, seen_by_both, tilted
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.scene import SceneConfig

GRID_COLUMNS, GRID_ROWS = 6, 5
"""Places in the image that the board's centre visits in turn."""
JITTER = 0.35
"""How far it may miss a place, in steps of the grid [-]."""
TRIES = 1000
"""Poses drawn for one place until both cameras see the whole board ..."""
INWARDS = 0.02
"""... each a little nearer to the centre of the image, by this fraction of the distance [-]."""


@dataclass(frozen=True, kw_only=True)
class ShotConfig:
    """How the board is shown."""

    shots: int = 30
    """Pairs of pictures [-]."""
    distance: tuple[float, float] = (0.33, 0.48)
    """From the camera to the centre of the board [m]: farther, and the table is in the way."""
    tilt_deg: tuple[float, float] = (20.0, 45.0)
    """Between the line of sight and the board's normal [deg]."""
    camera: CameraConfig = field(default_factory=lambda: CameraConfig(supersampling=3))
    """Straight edges of high contrast need finer drawing than skin."""

    def __post_init__(self) -> None:
        for name, (low, high), limit in (
            ("distance", self.distance, 0.6),
            ("tilt_deg", self.tilt_deg, 60.0),
        ):
            if not 0 < low < high <= limit:
                raise ConfigError(
                    f"{name} must rise within 0 .. {limit}, got {low} .. {high}",
                    getattr(self, name),
                )
        if self.shots < 1:
            raise ConfigError(f"the number of shots must be positive, got {self.shots}", self.shots)


class ShownBoard:
    """The pictures of a board that floats from place to place, and the scene with the cameras
    that take them.
    """

    def __init__(self, board: Board, seed: int, config: ShotConfig | None = None) -> None:
        """Draw the poses; `seed` is theirs and of the cameras' noise. Pictures are taken when
        asked for.
        """
        config = config or ShotConfig()
        camera = replace(config.camera, seed=seed)
        self.scene = BoardScene(SceneConfig(camera=camera), board, held=False)
        self._X_LBoard = board_poses(self.scene.rig, board, config, np.random.default_rng(seed))

    def __iter__(self) -> Iterator[tuple[str, StereoPair]]:
        """Name and pictures of each shot."""
        with closing(SimStereoCamera(self.scene)) as camera:
            for number, X in enumerate(self._X_LBoard):
                self.scene.place_board(self.scene.X_BL @ X)
                yield f"{number:02d}", camera.capture()


def board_poses(
    rig: StereoRig, board: Board, config: ShotConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 4 4"]:
    """Poses `X_LBoard` all over the images of both cameras, which take turns, about ever new
    axes of tilt.
    """
    return np.array(
        [_board_pose(rig, board, config, number, rng) for number in range(config.shots)]
    )


def _board_pose(
    rig: StereoRig, board: Board, config: ShotConfig, number: int, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    side = ("left", "right")[number % 2]
    camera: Intrinsics = getattr(rig, side)
    X_LC = np.eye(4) if side == "left" else se3.inverse(rig.X_RL)
    place = np.array([number % GRID_COLUMNS, (number // GRID_COLUMNS) % GRID_ROWS])
    centre = (np.array([GRID_COLUMNS, GRID_ROWS]) - 1) / 2
    for _ in range(TRIES):
        fraction = (place + 0.5 + rng.uniform(-JITTER, JITTER, 2)) / (GRID_COLUMNS, GRID_ROWS)
        ray_C = _ray(camera, fraction * (camera.width, camera.height))
        X_LBoard = (
            X_LC
            @ _facing(ray_C, rng.uniform(*config.distance))
            @ tilted(number, config.tilt_deg, rng)
            @ centred(board)
        )
        if seen_by_both(rig, X_LBoard, board):
            return X_LBoard
        place = place + INWARDS * (centre - place)
    raise ConfigError(
        "the two cameras of this rig see no board in common at these distances", config
    )


def _ray(camera: Intrinsics, pixel: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
    """Unit vector from the camera through a pixel."""
    ray = np.append(cv2.undistortPoints(pixel[None, None], camera.K, camera.distortion)[0, 0], 1.0)
    return ray / np.linalg.norm(ray)


def _facing(ray_C: Float[np.ndarray, "3"], distance: float) -> Float[np.ndarray, "4 4"]:
    """A frame on the ray that looks along it [m]."""
    axis = np.cross((0.0, 0.0, 1.0), ray_C)
    sine = np.linalg.norm(axis)
    rotation = axis / max(sine, 1e-9) * np.arctan2(sine, ray_C[2])
    return se3.from_rotation_vector(rotation, distance * ray_C)
