"""How well is the cameras' place in the robot's base found, with an arm that is not exact and an estimated rig?

The simulated arm shows the board it holds to the simulated cameras from all sides; what it states of its poses is
disturbed as a real arm's repeatability would. Pictures and poses land on disk and are calibrated from there.
"""

from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from breastscan.commands import calibrate, shots
from breastscan.errors import ConfigError
from breastscan.geometry import kinematics, se3
from breastscan.run import writing
from breastscan.vision.boards.board import Board
from breastscan.vision.camera import StereoRig
from sim.cameras.board import X_FBOARD, BoardScene, seen_by_both
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.rig_errors import rig_errors
from sim.robot import SimRobot
from sim.room.clearance import Clearance
from sim.scene import HOME_Q, SceneConfig

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Successive multiples of this spread evenly over the circle [rad]."""
TRIES = 200
"""Places drawn for one tilt until the arm reaches it freely and both cameras see the board."""
CLEARANCE = 0.02
"""Least gap between the arm and its surroundings [m]."""
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
    """Middle of the board's places in B [m]: above where the breast will be."""
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
            raise ConfigError(f"tilt_deg must rise within 0 .. 45, got {self.tilt_deg}", self.tilt_deg)
        if not (self.position_noise >= 0 and self.rotation_noise_deg >= 0):
            raise ConfigError("position_noise and rotation_noise_deg must not be negative", self)


def run(out: Path, *, rig: StereoRig, seed: int, board: Board, config: PoseConfig) -> dict[str, object]:
    """Show the board, calibrate from what landed in `out`, and compare with the truth.

    Args:
        out: Where shots, poses and results go; earlier ones stay until these are complete.
        rig: The cameras as calibrated; what their pictures are made with stays the scene's own.
        seed: Of the poses, the arm's errors and the cameras' noise.
        board: The board.
        config: Where it is shown.

    Returns:
        The metrics, as in `metrics.json`.
    """
    with writing.staged(out) as folder:
        rng = np.random.default_rng(seed)
        scene = BoardScene(SceneConfig(camera=replace(config.camera, seed=seed)), board, held=True)
        take_shots(folder, scene, joint_poses(scene, board, config, rng), config, rng)
        result = calibrate.hand_eye_from_shots(folder, folder, rig, board)
        metrics = calibrate.hand_eye_metrics(result) | rig_errors(result.rig, scene.rig)
        writing.write_json(folder / calibrate.METRICS_FILE, metrics)
    return metrics


def take_shots(
    folder: Path, scene: BoardScene, q: Float[np.ndarray, "n 6"], config: PoseConfig, rng: np.random.Generator
) -> None:
    """Drive the arm from pose to pose; write a pair of pictures at each, and what the arm states of its flange."""
    robot, stated = SimRobot(scene), {}
    with closing(SimStereoCamera(scene, robot)) as camera:
        for number, target in enumerate(q):
            robot.move_joint(target, JOINT_SPEED, JOINT_ACCELERATION)
            name = f"{number:02d}"
            shots.write_shot(folder, name, camera.capture())
            stated[name] = _disturbed(kinematics.forward(robot.state().q), config, rng)
    shots.write_poses(folder, stated)


def joint_poses(
    scene: BoardScene, board: Board, config: PoseConfig, rng: np.random.Generator
) -> Float[np.ndarray, "n 6"]:
    """Joint angles [rad] that show the whole board to both cameras, tilted about ever new axes, near one another."""
    clearance, poses = Clearance(scene), [HOME_Q]
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
    axis = number * GOLDEN_ANGLE
    for _ in range(TRIES):
        tilt = np.radians(rng.uniform(*config.tilt_deg)) * np.array([np.cos(axis), np.sin(axis), 0.0])
        spin = np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)])
        place = se3.pose(np.eye(3), np.array(config.place) + rng.uniform(-1, 1, 3) * config.reach)
        turn = se3.from_rotation_vector(tilt, np.zeros(3)) @ se3.from_rotation_vector(spin, np.zeros(3))
        X_BBoard = place @ FACE_UP @ turn @ se3.pose(np.eye(3), -board.centre)
        if not seen_by_both(scene.rig, se3.inverse(scene.X_BL) @ X_BBoard, board):
            continue
        reachable = kinematics.inverse(X_BBoard @ se3.inverse(X_FBOARD))
        for q in sorted(reachable, key=lambda q: np.abs(_wrapped(q - q_before)).max()):
            q_near = q_before + _wrapped(q - q_before)
            if np.abs(q_near).max() < 2 * np.pi and clearance.closest(q_near).distance > CLEARANCE:
                return q_near
    raise ConfigError(f"the arm cannot show the board about {config.place}: place it nearer to the cameras", config)


def _wrapped(angles: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """The same angles in -pi .. pi [rad]."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _disturbed(
    X_BF: Float[np.ndarray, "4 4"], config: PoseConfig, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """What an arm states that is not exact."""
    turn = np.radians(config.rotation_noise_deg) * rng.standard_normal(3)
    return X_BF @ se3.from_rotation_vector(turn, config.position_noise * rng.standard_normal(3))
