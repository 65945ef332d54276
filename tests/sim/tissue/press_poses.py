"""Where the tests press: the probe square on the skin of a phantom's half-height loop."""

import numpy as np
from jaxtyping import Float

from sim.tissue.phantom import Phantom

REST = np.zeros(3)
"""Velocity of a probe held still [m/s]."""


def loop_pose(phantom: Phantom, azimuth: float, depth: float) -> Float[np.ndarray, "4 4"]:
    """X_SP of a probe at `azimuth` [rad] of the half-height loop, its face `depth` [m] below the
    undeformed skin.
    """
    p_S = _loop_point(phantom, azimuth)
    inward_S = -phantom.normal(phantom.inverse_map(p_S[None]))[0]
    along_S = np.cross([0.0, 0.0, 1.0], inward_S)
    along_S /= np.linalg.norm(along_S)
    X_SP = np.eye(4)
    X_SP[:3, 0] = along_S
    X_SP[:3, 1] = np.cross(inward_S, along_S)
    X_SP[:3, 2] = inward_S
    X_SP[:3, 3] = p_S + depth * inward_S
    return X_SP


def _loop_point(phantom: Phantom, azimuth: float) -> Float[np.ndarray, "3"]:
    loop_S = phantom.level_loop(phantom.height / 2, 3600)
    angles = 2 * np.pi * np.arange(3600) / 3600
    return np.array([np.interp(azimuth, angles, column, period=2 * np.pi) for column in loop_S.T])
