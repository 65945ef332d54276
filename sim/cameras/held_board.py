"""A board that the twin's arm shows to the twin's cameras from all sides: pictures for a hand-eye
calibration.

What the arm states of its poses is disturbed as a real arm's repeatability would.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from breastscan.camera.interface import StereoPair
from breastscan.errors import ConfigError
from breastscan.geometry import kinematics, se3
from breastscan.planning.clearance import Clearance
from breastscan.vision.board import Board
from sim.cameras.board import BoardScene, X_FBoard, centred, seen_by_both, tilted
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.robot import SimRobot
from sim.room.cell import walled_cell
from sim.scene import HOME_Q, SceneConfig

TRIES = 200
"""Places drawn for one tilt until the arm reaches it freely and both cameras see the board."""
CLEARANCE = 0.02
"""Minimum gap between the arm and its surroundings [m]."""
JOINT_SPEED, JOINT_ACCELERATION = 1.0, 2.0
"""Of the moves from pose to pose [rad/s, rad/s^2]."""
FACE_UP = se3.from_rotation_vector(np.array([0.0, np.pi, 0.0]), np.zeros(3))
"""A board that lies with its face up, in B: then the flange looks down on the base's side of it."""


@dataclass(frozen=True, kw_only=True)
class PoseConfig:
    """Where the arm shows the board, and how well it knows."""

    poses: int = 36
    """Poses [-]."""
    place: tuple[float, float, float] = (0.50, 0.0, 0.21)
    """Centre of the board's places in B [m]: above where the breast will be."""
    reach: tuple[float, float, float] = (0.06, 0.06, 0.06)
    """How far the places spread about it [m]."""
    tilt_deg: tuple[float, float] = (15.0, 30.0)
    """Between the vertical and the board's normal [deg]."""
    position_noise: float = 5e-5
    """Error of each stated coordinate, one sigma [m]."""
    rotation_noise_deg: float = 0.01
    """Error of the stated rotation about each axis, one sigma [deg]."""
    camera: CameraConfig = field(default_factory=lambda: CameraConfig(supersampling=3))
    """Straight edges of high contrast need finer drawing than skin."""

    def __post_init__(self) -> None:
        if self.poses < 1:
            raise ConfigError(f"the number of poses must be positive, got {self.poses}", self.poses)
        if not 0 <= self.tilt_deg[0] <= self.tilt_deg[1] <= 45:
            raise ConfigError(
                f"tilt_deg must rise within 0 .. 45, got {self.tilt_deg}", self.tilt_deg
            )
        if not (self.position_noise >= 0 and self.rotation_noise_deg >= 0):
            raise ConfigError("position_noise and rotation_noise_deg must not be negative", self)


class HeldBoard:
    """The pictures of a board that the arm holds, what it states of its flange at each, and the
    scene of them.
    """

    def __init__(self, board: Board, seed: int, config: PoseConfig | None = None) -> None:
        """Draw the poses; `seed` is theirs, of the arm's errors and of the cameras' noise."""
        self._config = config or PoseConfig()
        self._rng = np.random.default_rng(seed)
        camera = replace(self._config.camera, seed=seed)
        self.scene = BoardScene(SceneConfig(camera=camera), board, held=True)
        self._q = joint_poses(self.scene, board, self._config, self._rng)

    def __iter__(self) -> Iterator[tuple[str, StereoPair, Float[np.ndarray, "4 4"]]]:
        """Name, pictures and stated `X_BF` of each pose, to which the arm drives."""
        robot = SimRobot(self.scene)
        with closing(SimStereoCamera(self.scene, robot)) as camera:
            for number, target in enumerate(self._q):
                robot.move_joint(target, JOINT_SPEED, JOINT_ACCELERATION)
                pair = camera.capture()
                yield (
                    f"{number:02d}",
                    pair,
                    _disturbed(kinematics.forward(robot.state().q), self._config, self._rng),
                )


def joint_poses(
    scene: BoardScene, board: Board, config: PoseConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 6"]:
    """Joint angles [rad] that show the whole board to both cameras, tilted about ever new axes,
    near one another.
    """
    clearance, poses = walled_cell(scene).clearance, [HOME_Q]
    for number in range(config.poses):
        poses.append(_joint_pose(scene, clearance, board, config, number, poses[-1], rng))
    return np.array(poses[1:])


def _joint_pose(
    scene: BoardScene,
    clearance: Clearance,
    board: Board,
    config: PoseConfig,
    number: int,
    q_before: Float[np.ndarray, "6"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "6"]:
    for _ in range(TRIES):
        rotation = tilted(number, config.tilt_deg, rng)
        place = se3.pose(np.eye(3), np.array(config.place) + rng.uniform(-1, 1, 3) * config.reach)
        X_BBoard = place @ FACE_UP @ rotation @ centred(board)
        if not seen_by_both(scene.rig, se3.inverse(scene.X_BL) @ X_BBoard, board):
            continue
        reachable = kinematics.inverse(X_BBoard @ se3.inverse(X_FBoard))
        for q in sorted(reachable, key=lambda q: np.abs(_wrapped(q - q_before)).max()):
            q_near = q_before + _wrapped(q - q_before)
            if np.abs(q_near).max() < 2 * np.pi and clearance.closest(q_near).distance > CLEARANCE:
                return q_near
    raise ConfigError(
        f"the arm cannot show the board about {config.place}: place it nearer to the cameras",
        config,
    )


def _wrapped(angles: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """The same angles in -pi .. pi [rad]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _disturbed(
    X_BF: Float[np.ndarray, "4 4"], config: PoseConfig, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """What an arm states that is not exact."""
    rotation = np.radians(config.rotation_noise_deg) * rng.standard_normal(3)
    return X_BF @ se3.from_rotation_vector(rotation, config.position_noise * rng.standard_normal(3))
