"""How well does the calibration find the twin's own cameras, from pictures alone?

A board is shown to the simulated cameras as a careful operator would: everywhere in both images, near, and tilted about
changing axes. The pictures land on disk and are calibrated from there, like those of real cameras.
"""

from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from breastscan.commands import calibrate, shots
from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.run import writing
from breastscan.vision.boards.board import Board
from breastscan.vision.camera import Intrinsics, StereoRig
from sim.cameras.board import BoardScene, seen_by_both
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.rig_errors import rig_errors
from sim.scene import SceneConfig

GRID_COLUMNS, GRID_ROWS = 6, 5
"""Places in the image that the board's middle visits in turn."""
JITTER = 0.35
"""How far it may miss a place, in steps of the grid [-]."""
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Successive multiples of this spread evenly over the circle [rad]."""
TRIES = 1000
"""Poses drawn for one place until both cameras see the whole board ..."""
INWARDS = 0.02
"""... each a little nearer to the middle of the image, by this share of the way [-]."""


@dataclass(frozen=True, kw_only=True)
class ShotConfig:
    """How the board is shown."""

    shots: int = 30
    """Pairs of pictures [-]."""
    distance: tuple[float, float] = (0.33, 0.48)
    """From the camera to the middle of the board [m]: farther, and the table is in the way."""
    tilt_deg: tuple[float, float] = (20.0, 45.0)
    """Between the line of sight and the board's normal [deg]."""
    camera: CameraConfig = field(default_factory=lambda: CameraConfig(supersampling=3))
    """Straight edges of high contrast need finer drawing than skin."""

    def __post_init__(self) -> None:
        for name, (low, high), limit in (("distance", self.distance, 0.6), ("tilt_deg", self.tilt_deg, 60.0)):
            if not 0 < low < high <= limit:
                raise ConfigError(f"{name} must rise within 0 .. {limit}, got {low} .. {high}", getattr(self, name))
        if self.shots < 1:
            raise ConfigError(f"the number of shots must be positive, got {self.shots}", self.shots)


def run(out: Path, *, seed: int, board: Board, config: ShotConfig) -> dict[str, object]:
    """Render the shots into `out`, calibrate from them, and compare with the truth.

    Args:
        out: Where shots and results go; earlier ones stay until these are complete.
        seed: Of the board's poses and the cameras' noise.
        board: The board.
        config: How it is shown.

    Returns:
        The metrics, as in `metrics.json`.
    """
    with writing.staged(out) as folder:
        scene = BoardScene(SceneConfig(camera=replace(config.camera, seed=seed)), board, held=False)
        render_shots(folder, scene, board_poses(scene.rig, board, config, np.random.default_rng(seed)))
        calibration = calibrate.rig_from_shots(folder, folder, board)
        metrics = calibrate.rig_metrics(calibration) | rig_errors(calibration.rig, scene.rig)
        writing.write_json(folder / calibrate.METRICS_FILE, metrics)
    return metrics


def render_shots(folder: Path, scene: BoardScene, X_LBoard: Float[np.ndarray, "n 4 4"]) -> None:
    """Write a pair of pictures of the board at each pose."""
    with closing(SimStereoCamera(scene)) as camera:
        for number, X in enumerate(X_LBoard):
            scene.place_board(scene.X_BL @ X)
            shots.write_shot(folder, f"{number:02d}", camera.capture())


def board_poses(
    rig: StereoRig, board: Board, config: ShotConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 4 4"]:
    """Poses `X_LBoard` all over the images of both cameras, which take turns, about ever new axes of tilt."""
    return np.array([_board_pose(rig, board, config, number, rng) for number in range(config.shots)])


def _board_pose(
    rig: StereoRig, board: Board, config: ShotConfig, number: int, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    side = ("left", "right")[number % 2]
    camera: Intrinsics = getattr(rig, side)
    X_LC = np.eye(4) if side == "left" else se3.inverse(rig.X_RL)
    place = np.array([number % GRID_COLUMNS, (number // GRID_COLUMNS) % GRID_ROWS])
    middle = (np.array([GRID_COLUMNS, GRID_ROWS]) - 1) / 2
    for _ in range(TRIES):
        share = (place + 0.5 + rng.uniform(-JITTER, JITTER, 2)) / (GRID_COLUMNS, GRID_ROWS)
        ray_C = _ray(camera, share * (camera.width, camera.height))
        X_LBoard = X_LC @ _facing(ray_C, rng.uniform(*config.distance)) @ _tilt(number, config, rng) @ _centred(board)
        if seen_by_both(rig, X_LBoard, board):
            return X_LBoard
        place = place + INWARDS * (middle - place)
    raise ConfigError("the two cameras of this rig see no board in common at these distances", config)


def _ray(camera: Intrinsics, pixel: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
    """Unit vector from the camera through a pixel."""
    ray = np.append(cv2.undistortPoints(pixel[None, None], camera.K, camera.distortion)[0, 0], 1.0)
    return ray / np.linalg.norm(ray)


def _facing(ray_C: Float[np.ndarray, "3"], distance: float) -> Float[np.ndarray, "4 4"]:
    """A frame on the ray that looks along it [m]."""
    axis = np.cross((0.0, 0.0, 1.0), ray_C)
    sine = np.linalg.norm(axis)
    turn = axis / max(sine, 1e-9) * np.arctan2(sine, ray_C[2])
    return se3.from_rotation_vector(turn, distance * ray_C)


def _tilt(number: int, config: ShotConfig, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """A tilt about an axis that goes round from shot to shot, after a small turn about the line of sight."""
    axis = number * GOLDEN_ANGLE
    tilt = np.radians(rng.uniform(*config.tilt_deg)) * np.array([np.cos(axis), np.sin(axis), 0.0])
    spin = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)])
    return se3.from_rotation_vector(tilt, np.zeros(3)) @ se3.from_rotation_vector(spin, np.zeros(3))


def _centred(board: Board) -> Float[np.ndarray, "4 4"]:
    """The board in a frame at its middle."""
    return se3.pose(np.eye(3), -board.centre)
