"""A short path on the twin's phantom, planned without cameras and without a planner."""

import numpy as np

from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion
from experiments.sections import section

NOMINAL = KinematicCalibration.nominal()
ELBOW_UP = np.radians([-170.0, -57.0, 80.0, -55.0, -112.0, -49.0])
"""Far from every singularity halfway along the path [rad]."""
PATH_POINTS = 200
"""Poses from which the joints are interpolated."""


def arc_motion(scene, truth, length, speed=0.025, clearance=0.012):
    """A part of the half-height loop, on the side where y is greatest, from rest to rest."""
    loop_S = truth.level_loop()
    centre = int(loop_S[:, 1].argmax())
    step = np.linalg.norm(loop_S[1] - loop_S[0])
    reach = int(0.5 * (length + 0.01) / step)
    points_S = loop_S[np.linspace(centre - reach, centre + reach, PATH_POINTS).astype(int)]
    points_S, normals_S = truth.closest(points_S)
    X_BP = [scene.X_BS @ se3.pose(_upright(n), p) for p, n in zip(points_S, normals_S, strict=True)]
    q = [_nearest(kinematics.inverse(X_BP[0] @ se3.inverse(scene.X_FP)), ELBOW_UP)]
    for X in X_BP[1:]:
        q.append(NOMINAL.refined(q[-1], X @ se3.inverse(scene.X_FP)))
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_S, axis=0), axis=1))])
    q = np.array(q)
    whole = Motion(q=q, qd=np.zeros_like(q), s=s, q_approach=q[0], clearance=clearance)
    return section(whole, scene.X_FP, start=0.002, length=length, speed=speed)


def _upright(normal_S):
    """Orientation of a probe along -normal, its array level."""
    x = np.cross(normal_S, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(-normal_S, x), -normal_S], axis=1)


def _nearest(solutions, q):
    unwound = q + (solutions - q + np.pi) % (2 * np.pi) - np.pi
    return unwound[np.abs(unwound - q).max(axis=1).argmin()]
