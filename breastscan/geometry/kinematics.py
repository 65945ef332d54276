"""Kinematics of the UR5e: forward, inverse in closed form, Jacobian, distance from singularities.

DH frame 0 is B and frame 6 is F, in Universal Robots' own convention: at q = 0 the arm lies
stretched along -x of B. The loops over poses are compiled, because a controller calls them at 500
Hz and a planner for 1e5 poses at a time.
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

DH_D = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
"""Link offsets [m], from Universal Robots, "DH parameters for calculations of kinematics and
dynamics"."""
DH_A = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
"""Link lengths [m], same source."""
DH_ALPHA = np.array([math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0])
"""Link twists [rad], same source."""

ROUNDING = 1e-10
"""How far a sine or cosine may pass 1, or a sine fall short of 0, by rounding alone."""


def forward(q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 4 4"]:
    """Flange pose `X_BF` [m] at joint angles `q` [rad]."""
    return _link_frames(np.ascontiguousarray(q).reshape(-1, 6))[:, 6].reshape(*q.shape[:-1], 4, 4)


def link_heights(q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 7"]:
    """Heights of all DH frames' origins over B's [m], from frame 0 (B) to frame 6 (F): for
    checks against the table.
    """
    return _link_heights(np.ascontiguousarray(q).reshape(-1, 6)).reshape(*q.shape[:-1], 7)


def jacobian(q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 6 6"]:
    """Geometric Jacobian of the flange's origin in B: joint speeds to its (linear [m/s], angular
    [rad/s]) velocity.
    """
    return _jacobians(np.ascontiguousarray(q).reshape(-1, 6)).reshape(*q.shape[:-1], 6, 6)


def inverse(X_BF: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "k 6"]:
    """All joint angles in (-pi, pi] [rad] that reach one flange pose: none where it is out of
    reach, 8 at most.

    Where the wrist is singular (sin q5 = 0) joints 4 and 6 rotate about the same axis; the solution
    with q6 = 0 stands for all.
    """
    branches = inverse_branches(X_BF)
    return branches[~np.isnan(branches[:, 0])]


def inverse_branches(X_BF: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 8 6"]:
    """The eight branches of the inverse kinematics of each pose [rad], rows of NaN where a branch
    does not exist.

    A branch keeps its index along a continuous motion: 4 * shoulder + 2 * wrist + elbow, where
    shoulder is the side on which joint 1 carries the arm, wrist is 1 where q5 < 0 and elbow is 1
    where q3 < 0.
    """
    return _inverse_branches(np.ascontiguousarray(X_BF).reshape(-1, 4, 4)).reshape(
        *X_BF.shape[:-2], 8, 6
    )


def reach_excess(X_BF: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b"]:
    """By how much the wrist of each pose lies beyond what any branch reaches [m]; 0 where the
    pose is reachable.
    """
    return _reach_excess(np.ascontiguousarray(X_BF).reshape(-1, 4, 4)).reshape(X_BF.shape[:-2])


def singularity_measure(q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b"]:
    """The minimum of the three factors that vanish at the arm's singularities, each 1 at best or
    about so.

    They are |sin q3| (elbow stretched), |sin q5| (wrist folded) and the distance of the wrist's
    centre from the plane through joint axes 1 and 2, over the length of both links (shoulder). The
    Jacobian's determinant is their product times a2 a3 (a2 + a3).
    """
    return np.asarray(np.min(np.abs(singularity_factors(q)), axis=-1))


def singularity_factors(q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 3"]:
    """Elbow, wrist and shoulder factor of `singularity_measure`, with their signs: a branch
    keeps all three.
    """
    q23, q234 = q[..., 1] + q[..., 2], q[..., 1] + q[..., 2] + q[..., 3]
    wrist_distance = DH_A[1] * np.cos(q[..., 1]) + DH_A[2] * np.cos(q23) + DH_D[4] * np.sin(q234)
    return np.stack(
        [np.sin(q[..., 2]), np.sin(q[..., 4]), wrist_distance / (DH_A[1] + DH_A[2])], axis=-1
    )


# Below, `no_type_check` keeps the tests' run-time type checker from wrapping what numba compiles.


@numba.njit(cache=True)
@no_type_check
def _link_frames(q):
    X = np.zeros((len(q), 7, 4, 4))
    for k in range(len(q)):
        for i in range(4):
            X[k, 0, i, i] = 1.0
        for j in range(6):
            c, s = math.cos(q[k, j]), math.sin(q[k, j])
            ca, sa = math.cos(DH_ALPHA[j]), math.sin(DH_ALPHA[j])
            for i in range(3):
                x, y, z, p = X[k, j, i]
                along = c * x + s * y
                across = c * y - s * x
                X[k, j + 1, i, 0] = along
                X[k, j + 1, i, 1] = ca * across + sa * z
                X[k, j + 1, i, 2] = ca * z - sa * across
                X[k, j + 1, i, 3] = p + DH_A[j] * along + DH_D[j] * z
            X[k, j + 1, 3, 3] = 1.0
    return X


@numba.njit(cache=True)
@no_type_check
def _link_heights(q):
    heights = np.zeros((len(q), 7))
    for k in range(len(q)):
        # the upward components of the frame's axes
        x = 0.0
        y = 0.0
        z = 1.0
        for j in range(6):
            c, s = math.cos(q[k, j]), math.sin(q[k, j])
            ca, sa = math.cos(DH_ALPHA[j]), math.sin(DH_ALPHA[j])
            along = c * x + s * y
            across = c * y - s * x
            heights[k, j + 1] = heights[k, j] + DH_A[j] * along + DH_D[j] * z
            x = along
            y = ca * across + sa * z
            z = ca * z - sa * across
    return heights


@numba.njit(cache=True)
@no_type_check
def _jacobians(q):
    J = np.empty((len(q), 6, 6))
    X = _link_frames(q)
    for k in range(len(q)):
        for j in range(6):
            axis = X[k, j, :3, 2]
            arm = X[k, 6, :3, 3] - X[k, j, :3, 3]
            J[k, 0, j] = axis[1] * arm[2] - axis[2] * arm[1]
            J[k, 1, j] = axis[2] * arm[0] - axis[0] * arm[2]
            J[k, 2, j] = axis[0] * arm[1] - axis[1] * arm[0]
            J[k, 3:, j] = axis
    return J


@numba.njit(cache=True)
@no_type_check
def _wrap(angle):
    """`angle` in (-pi, pi]."""
    return angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))


@numba.njit(cache=True)
@no_type_check
def _shoulder_offset_sine(X):
    """Sine of the angle by which the lateral offset d4 rotates joint 1 from the wrist's azimuth,
    and that azimuth.
    """
    x = X[0, 3] - DH_D[5] * X[0, 2]
    y = X[1, 3] - DH_D[5] * X[1, 2]
    distance = max(math.hypot(x, y), 1e-12)
    return DH_D[3] / distance, math.atan2(y, x)


@numba.njit(cache=True)
@no_type_check
def _wrist(X, q1, wrist):
    """q5, q6, q2 + q3 + q4 and the place of frame 4 in the arm's plane (from joint 2, outwards
    and up).
    """
    c1, s1 = math.cos(q1), math.sin(q1)
    across = X[0, :3] * s1 - X[1, :3] * c1  # axis of joints 2 to 4 in the flange's basis
    sign = -1.0 if wrist else 1.0
    s5 = math.hypot(across[0], across[1])
    q5 = math.atan2(sign * s5, across[2])
    q6 = math.atan2(-sign * across[1], sign * across[0]) if s5 > ROUNDING else 0.0
    c6, s6 = math.cos(q6), math.sin(q6)
    z4 = -(s6 * X[:3, 0] + c6 * X[:3, 1])  # axis of joint 5 in B
    q234 = math.atan2(c1 * z4[0] + s1 * z4[1], -z4[2])
    p = X[:3, 3] - DH_D[5] * X[:3, 2] - DH_D[4] * z4
    return q5, q6, q234, c1 * p[0] + s1 * p[1], p[2] - DH_D[0]


@numba.njit(cache=True)
@no_type_check
def _inverse_branches(X):
    q = np.full((len(X), 8, 6), np.nan)
    a2, a3 = DH_A[1], DH_A[2]
    for k in range(len(X)):
        sine, azimuth = _shoulder_offset_sine(X[k])
        if sine > 1.0 + ROUNDING:
            continue
        offset_angle = math.asin(min(sine, 1.0))
        for shoulder in range(2):
            q1 = azimuth + offset_angle if shoulder == 0 else azimuth + math.pi - offset_angle
            for wrist in range(2):
                q5, q6, q234, x, y = _wrist(X[k], q1, wrist)
                c3 = (x * x + y * y - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
                if abs(c3) > 1.0 + ROUNDING:
                    continue
                for elbow in range(2):
                    q3 = math.acos(min(max(c3, -1.0), 1.0)) * (1 - 2 * elbow)
                    q2 = math.atan2(y, x) - math.atan2(a3 * math.sin(q3), a2 + a3 * math.cos(q3))
                    row = q[k, 4 * shoulder + 2 * wrist + elbow]
                    row[0] = _wrap(q1)
                    row[1] = _wrap(q2)
                    row[2] = q3
                    row[3] = _wrap(q234 - q2 - q3)
                    row[4] = q5
                    row[5] = q6
    return q


@numba.njit(cache=True)
@no_type_check
def _reach_excess(X):
    excess = np.empty(len(X))
    longest, shortest = abs(DH_A[1] + DH_A[2]), abs(DH_A[1] - DH_A[2])
    for k in range(len(X)):
        sine, azimuth = _shoulder_offset_sine(X[k])
        offset_angle = math.asin(min(sine, 1.0))
        best = math.inf
        for shoulder in range(2):
            q1 = azimuth + offset_angle if shoulder == 0 else azimuth + math.pi - offset_angle
            for wrist in range(2):
                _, _, _, x, y = _wrist(X[k], q1, wrist)
                distance = math.hypot(x, y)
                best = min(best, max(distance - longest, shortest - distance, 0.0))
        too_near = max(DH_D[3] - DH_D[3] / sine, 0.0)  # the wrist inside the shoulder's offset
        excess[k] = max(best, too_near)
    return excess
