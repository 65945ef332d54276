"""Clouds of a known breast on a known chest, in no order."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from breastscan.geometry import se3

RADIUS, HEIGHT = 0.07, 0.05
"""Of the breast's foot, and over the chest [m]."""
SIDE = 0.26
"""Of the square of chest around it [m]."""
STEP = 2e-5
"""Of the differences that tell normals [m]."""


@dataclass(frozen=True, kw_only=True)
class Cloud:
    """Points and normals in B, and what they are drawn from."""

    points_B: np.ndarray
    normals_B: np.ndarray
    along: np.ndarray
    """Where on the chest each stands, (n 2) [m]."""
    loop_B: np.ndarray
    """The skin at half the breast's height, densely."""

    def where(self, kept: np.ndarray) -> "Cloud":
        return Cloud(
            points_B=self.points_B[kept],
            normals_B=self.normals_B[kept],
            along=self.along[kept],
            loop_B=self.loop_B,
        )


def bump(u: np.ndarray, v: np.ndarray, centre: float = 0.0) -> np.ndarray:
    """Height of a breast over its chest, with a rounded foot [m]."""
    return HEIGHT * np.clip(1 - (u**2 + (v - centre) ** 2) / RADIUS**2, 0, None) ** 1.6


def flat(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    none = np.zeros_like(u)
    return np.stack([u, v, none], axis=-1), np.stack([none, none, none + 1], axis=-1)


def cylinder(radius: float):
    """A chest that falls away to both sides of its crest, which runs along u."""

    def chest(u, v):
        angle = v / radius
        normals = np.stack([0 * u, np.sin(angle), np.cos(angle)], axis=-1)
        return np.stack([u, 0 * u, 0 * u - radius], axis=-1) + radius * normals, normals

    return chest


def tilted(angle: float, azimuth: float = 0.0, at: tuple = (0.5, 0.0, 0.1)) -> np.ndarray:
    """The pose of a chest that is tilted towards an azimuth [rad]."""
    axis = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return se3.pose(Rotation.from_rotvec(angle * axis).as_matrix(), np.array(at))


STANDING = se3.pose(np.array([[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]]), np.array([0.6, 0, 0.45]))
"""Of a chest whose normal points at the robot, horizontally."""


def cloud(
    chest=flat, X_BS=None, heights=bump, width: float = SIDE, count: int = 24_000, seed: int = 0
) -> Cloud:
    """Points with errors of .1 mm, evenly spread over the chest, fewer on the flank."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-SIDE / 2, SIDE / 2, count)
    v = rng.uniform(-width / 2, width / 2, count)
    X_BS = tilted(0.0) if X_BS is None else X_BS

    def skin(u, v):
        p_S, n_S = chest(u, v)
        return p_S + heights(u, v)[..., None] * n_S

    across = skin(u + STEP, v) - skin(u - STEP, v)
    normals_S = np.cross(across, skin(u, v + STEP) - skin(u, v - STEP))
    normals_S /= np.linalg.norm(normals_S, axis=1, keepdims=True)
    points_S = skin(u, v) + 1e-4 * rng.standard_normal((count, 1)) * normals_S
    azimuth = np.linspace(0, 2 * np.pi, 2000)
    reach = RADIUS * np.sqrt(1 - 0.5 ** (1 / 1.6))
    loop_S = skin(reach * np.cos(azimuth), reach * np.sin(azimuth))
    return Cloud(
        points_B=se3.transform(X_BS, points_S),
        normals_B=se3.rotate(X_BS, normals_S),
        along=np.column_stack([u, v]),
        loop_B=se3.transform(X_BS, loop_S),
    )
