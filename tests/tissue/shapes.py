"""Breasts of known shape, as clouds of points in the base's frame."""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.plane import Plane

RADIUS, HEIGHT = 0.075, 0.055
"""Of the foot and of the top [m]."""
CHEST = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.0)
POINTS = 3000


def dome(direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Half an ellipsoid, from points of the unit half-ball [m]."""
    return direction * np.array([RADIUS, RADIUS, HEIGHT])


def dome_cloud(seed: int, lowest: float = 2.5e-3) -> Float[np.ndarray, "n 3"]:
    """Points of the dome's skin from some height over the chest on [m]."""
    direction = np.random.default_rng(seed).standard_normal((POINTS, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    points = dome(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    return points[points[:, 2] > lowest]


def dome_normal(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Outward unit normals of the dome's skin."""
    gradient = points / np.array([RADIUS, RADIUS, HEIGHT]) ** 2
    return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)


def off_the_dome(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """About how far points lie outside the dome's skin [m]."""
    scaled = np.linalg.norm(points / np.array([RADIUS, RADIUS, HEIGHT]), axis=1)
    return (scaled - 1) * np.linalg.norm(points, axis=1)


def tilted() -> Float[np.ndarray, "4 4"]:
    """Where a chest may lie in the base: leaning, and off its origin."""
    return se3.from_rotation_vector(np.array([0.2, -0.15, 0.4]), np.array([0.5, 0.03, 0.08]))


def probes(polar: float, count: int) -> Float[np.ndarray, "k 4 4"]:
    """Poses square on the dome's skin around its top, arrays along their circle."""
    azimuth = 2 * np.pi * np.arange(count) / count
    around = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1)
    points = dome(np.sin(polar) * around + np.cos(polar) * np.array([0.0, 0.0, 1.0]))
    inward = -dome_normal(points)
    along = np.cross(np.array([0.0, 0.0, 1.0]), around)
    axes = np.stack([along, np.cross(inward, along), inward], axis=2)
    return se3.pose(axes, points)
