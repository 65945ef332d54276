"""The UR5e as the product of the matrices that its DH parameters make."""

import numpy as np

from breastscan.geometry import se3

UR5E_ROWS = [
    # d, a, alpha in metres and degrees, as Universal Robots' table prints them
    (0.1625, 0.0, 90.0),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, 90.0),
    (0.0997, 0.0, -90.0),
    (0.0996, 0.0, 0.0),
]


def dh_frames(q: np.ndarray) -> np.ndarray:
    """Poses of DH frames 0 (B) to 6 (F) in B at joint angles `q` [rad]."""
    frames = [np.eye(4)]
    for angle, (d, a, alpha_deg) in zip(q, UR5E_ROWS, strict=True):
        rotation = se3.from_rotation_vector(np.array([0.0, 0.0, angle]), np.array([0.0, 0.0, d]))
        twist = se3.from_rotation_vector(
            np.array([np.radians(alpha_deg), 0.0, 0.0]), np.array([a, 0.0, 0.0])
        )
        frames.append(frames[-1] @ rotation @ twist)
    return np.array(frames)
