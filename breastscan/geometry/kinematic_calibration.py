"""Kinematics of one particular UR5e, with the corrections that Universal Robots measured on it.

Without them the flange is off by millimetres, on some arms by centimetres. The nominal arm of
`geometry.kinematics` stays as it is: its closed form gives all branches of the inverse, and
Newton's method takes them to the real arm.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from breastscan.errors import CalibrationError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematics import DH_A, DH_ALPHA, DH_D

NEWTON_STEPS = 40
"""Steps after which a branch that has not come to rest counts as absent."""
CONVERGED = 1e-12
"""Largest pose error at which Newton's method ends [m, rad]."""
LARGEST_STEP = 0.2
"""Largest joint change of a step [rad]: farther away lies another branch."""
NUDGE = 0.01
"""How far beyond the nominal arm's reach a solution is sought [m]: more than any calibration
moves the wrist."""
SAME = 1e-5
"""Joint angles closer together are one solution [rad]."""
LARGEST_CORRECTION = 0.05
"""How far the flange of a calibrated arm may lie from the nominal one's [m] before the file must be
of another arm."""
LENGTHS = {
    "shoulder's height": float(DH_D[0]),
    "upper arm": float(-DH_A[1]),
    "forearm": float(-DH_A[2]),
    "wrist 1": float(DH_D[3]),
    "wrist 2": float(DH_D[4]),
    "wrist 3": float(DH_D[5]),
}
"""Of a UR5e, between its joints' axes [m]; arms of other sizes differ by tens of millimetres."""
PARALLEL = 1e-12
"""Square of an angle below which two axes are parallel [rad^2]."""
LARGEST_LENGTH_ERROR = 0.01
"""By how much one may differ [m]: a calibrated arm's do by a few millimetres."""


@dataclass(frozen=True, kw_only=True)
class KinematicCalibration:
    """Where the joint axes of one arm really are, and the kinematics that follow."""

    X_joints: Float[np.ndarray, "6 4 4"]
    """Each joint's frame at angle 0 in the frame that rotates with the previous joint; the first
    one in B [m]."""
    X_6F: Float[np.ndarray, "4 4"]
    """The flange in the frame that rotates with joint 6 [m]."""

    def __post_init__(self) -> None:
        for (name, expected), length in zip(LENGTHS.items(), self._lengths(), strict=True):
            if not abs(length - expected) < LARGEST_LENGTH_ERROR:
                raise CalibrationError(
                    f"the calibrated arm's {name} is {length * 1e3:.1f} mm, expected a UR5e's, "
                    f"{expected * 1e3:.1f} mm within {LARGEST_LENGTH_ERROR * 1e3:.0f} mm: is the "
                    "file of another arm, or are its units not metres and radians?",
                    length,
                )
        parked = np.radians([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
        distance = float(
            np.linalg.norm(self.forward(parked)[:3, 3] - kinematics.forward(parked)[:3, 3])
        )
        if not distance < LARGEST_CORRECTION:
            raise CalibrationError(
                f"the calibrated flange lies {distance * 1e3:.0f} mm from the nominal UR5e's, "
                f"expected less than {LARGEST_CORRECTION * 1e3:.0f} mm: is the file of another "
                "arm, or are its units not metres and radians?",
                distance,
            )

    @staticmethod
    @cache
    def nominal() -> "KinematicCalibration":
        """The arm of the drawing, for want of its own file."""
        zero = np.zeros(6)
        return KinematicCalibration.from_dh_corrections(theta=zero, d=zero, a=zero, alpha=zero)

    @staticmethod
    def from_dh_corrections(
        *,
        theta: Float[np.ndarray, "6"],
        d: Float[np.ndarray, "6"],
        a: Float[np.ndarray, "6"],
        alpha: Float[np.ndarray, "6"],
    ) -> "KinematicCalibration":
        """The arm whose DH parameters are the nominal ones plus these.

        Args:
            theta: Corrections of the joint angles [rad].
            d: Of the link offsets [m].
            a: Of the link lengths [m].
            alpha: Of the link twists [rad].
        """
        z, x = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        X_rotations = se3.from_rotation_vector(theta[:, None] * z, np.zeros((6, 3)))
        X_links = se3.from_rotation_vector(
            (DH_ALPHA + alpha)[:, None] * x, (DH_A + a)[:, None] * x + (DH_D + d)[:, None] * z
        )
        X_before = np.concatenate([np.eye(4)[None], X_links[:-1]])
        return KinematicCalibration(X_joints=X_before @ X_rotations, X_6F=X_links[-1])

    def _lengths(self) -> tuple[float, ...]:
        """Of `LENGTHS`, from the axes in space: the offsets along three axes that are nearly
        parallel say nothing by themselves.
        """
        X = _joint_frames(np.zeros((1, 6)), self.X_joints, self.X_6F)[0]
        p, z = X[:, :3, 3], X[:, :3, 2]
        shoulder = _nearest_point(p[0], z[0], p[1], z[1])
        upper = _nearest_point(p[1], z[1], p[0], z[0])
        elbow = p[2] + ((upper - p[2]) @ z[2]) * z[2]
        wrist = p[3] + ((elbow - p[3]) @ z[3]) * z[3]
        fourth = _nearest_point(p[3], z[3], p[4], z[4])
        fifth_before = _nearest_point(p[4], z[4], p[3], z[3])
        fifth_after = _nearest_point(p[4], z[4], p[5], z[5])
        sixth = _nearest_point(p[5], z[5], p[4], z[4])
        return (
            float(shoulder @ z[0]),
            float(np.linalg.norm(elbow - upper)),
            float(np.linalg.norm(wrist - elbow)),
            float((fourth - wrist) @ z[3]),
            float((fifth_after - fifth_before) @ z[4]),
            float((p[6] - sixth) @ z[5]),
        )

    def forward(self, q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 4 4"]:
        """Flange pose `X_BF` [m] at joint angles `q` [rad]."""
        frames = _joint_frames(np.ascontiguousarray(q).reshape(-1, 6), self.X_joints, self.X_6F)
        return frames[:, 6].reshape(*q.shape[:-1], 4, 4)

    def link_frames(self, q: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6 4 4"]:
        """Frames in B [m] that rotate with each joint, z along its axis, at angles `q` [rad]."""
        before = _joint_frames(np.ascontiguousarray(q), self.X_joints, self.X_6F)[:, :6]
        rotated = np.zeros((*q.shape, 4, 4))
        rotated[..., 0, 0] = rotated[..., 1, 1] = np.cos(q)
        rotated[..., 1, 0], rotated[..., 0, 1] = np.sin(q), -np.sin(q)
        rotated[..., 2, 2] = rotated[..., 3, 3] = 1.0
        return before @ rotated

    def jacobian(self, q: Float[np.ndarray, "*b 6"]) -> Float[np.ndarray, "*b 6 6"]:
        """Geometric Jacobian of the flange's origin, as `kinematics.jacobian` gives it."""
        J = np.empty((q.size // 6, 6, 6))
        for one, frames in zip(
            J, _joint_frames(q.reshape(-1, 6), self.X_joints, self.X_6F), strict=True
        ):
            _flange_jacobian(frames, one)
        return J.reshape(*q.shape[:-1], 6, 6)

    def step(
        self, q: Float[np.ndarray, "6"], X_BF: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "6"]:
        """Joint angles one Newton step from `q` [rad] towards a pose: for targets that move
        little between calls.
        """
        q = np.ascontiguousarray(q)
        return q + _newton_step(
            _joint_frames(q[None], self.X_joints, self.X_6F)[0], np.ascontiguousarray(X_BF)
        )

    def inverse(self, X_BF: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "k 6"]:
        """All joint angles that reach one flange pose, as `kinematics.inverse` gives them."""
        branches = self.inverse_branches(X_BF)
        return branches[~np.isnan(branches[:, 0])]

    def inverse_branches(self, X_BF: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 8 6"]:
        """The eight branches of each pose [rad], under the index that they have for the nominal
        arm.

        None is missing where `kinematics.singularity_measure` is .1 or more; next to a singularity
        two branches meet and one of them may be lost.
        """
        goals = np.broadcast_to(X_BF[..., None, :, :], (*X_BF.shape[:-2], 8, 4, 4))
        q = self.refined(kinematics.inverse_branches(X_BF), goals)
        # a pose that the nominal arm just cannot reach may be in reach of this one
        for nudge in (-NUDGE, NUDGE):
            absent = np.isnan(q[..., 0])
            nearby = kinematics.inverse_branches(_nudged(X_BF, nudge))
            q[absent] = self.refined(nearby[absent], goals[absent])
            q[absent & _twins(q)] = np.nan
        return q

    def refined(
        self, q: Float[np.ndarray, "*b 6"], X_BF: Float[np.ndarray, "*b 4 4"]
    ) -> Float[np.ndarray, "*b 6"]:
        """The joint angles next to `q` [rad] with which this arm reaches the poses; NaN where
        there are none.
        """
        angles = np.ascontiguousarray(q).reshape(-1, 6).copy()
        _refine(angles, np.ascontiguousarray(X_BF).reshape(-1, 4, 4), self.X_joints, self.X_6F)
        return angles.reshape(q.shape)


def _nearest_point(p: np.ndarray, z: np.ndarray, p2: np.ndarray, z2: np.ndarray) -> np.ndarray:
    """The point of a line through `p` along `z` that is nearest to another line; far away where the
    two are parallel.
    """
    across = np.cross(z, z2)
    return p + z * (np.cross(p2 - p, z2) @ across) / max(across @ across, PARALLEL)


def _nudged(X_BF: np.ndarray, distance: float) -> np.ndarray:
    """The poses moved by `distance` [m] away from the shoulder."""
    X_moved = X_BF.copy()
    arm_B = X_BF[..., :3, 3] - np.array([0.0, 0.0, DH_D[0]])
    X_moved[..., :3, 3] += distance * arm_B / np.linalg.norm(arm_B, axis=-1, keepdims=True)
    return X_moved


def _twins(q: np.ndarray) -> np.ndarray:
    """Which of the eight branches equal another one, because Newton's method crossed over."""
    apart = np.abs(np.angle(np.exp(1j * (q[..., :, None, :] - q[..., None, :, :])))).max(axis=-1)
    others = np.where(np.eye(8, dtype=bool), np.inf, np.nan_to_num(apart, nan=np.inf))
    return np.asarray(others.min(axis=-1) < SAME)


@numba.njit(cache=True)
@no_type_check  # keeps the tests' run-time type checker from wrapping what numba compiles
def _joint_frames(q, X_joints, X_6F):
    """Frames in B before each joint rotates (their z axes are the joints' axes), and at last the
    flange.
    """
    frames = np.empty((len(q), 7, 4, 4))
    for k in range(len(q)):
        X = np.eye(4)
        for j in range(6):
            X = X @ X_joints[j]
            frames[k, j] = X
            c, s = math.cos(q[k, j]), math.sin(q[k, j])
            for i in range(3):
                x, y = X[i, 0], X[i, 1]
                X[i, 0], X[i, 1] = c * x + s * y, c * y - s * x
        frames[k, 6] = X @ X_6F
    return frames


@numba.njit(cache=True)
@no_type_check
def _flange_jacobian(frames, J):
    for j in range(6):
        axis = frames[j, :3, 2]
        J[:3, j] = np.cross(axis, frames[6, :3, 3] - frames[j, :3, 3])
        J[3:, j] = axis


@numba.njit(cache=True)
@no_type_check
def _pose_error(X, X_goal):
    """Translation and small rotation from `X` to the goal, in B."""
    error = np.empty(6)
    error[:3] = X_goal[:3, 3] - X[:3, 3]
    error[3:] = 0.0
    for i in range(3):
        error[3:] += 0.5 * np.cross(X[:3, i], X_goal[:3, i])
    return error


@numba.njit(cache=True)
@no_type_check
def _newton_step(frames, X_goal):
    """Joint angles that take the flange to the goal, to first order."""
    J = np.empty((6, 6))
    _flange_jacobian(frames, J)
    # near a singularity the minimum-norm step is taken: J may not be invertible there
    return J.T @ np.linalg.solve(J @ J.T + 1e-14 * np.eye(6), _pose_error(frames[6], X_goal))


@numba.njit(cache=True)
@no_type_check
def _refine(q, X_goals, X_joints, X_6F):
    """Newton's method on each row of `q`, in place; NaN where it does not come to rest."""
    for k in range(len(q)):
        if np.isnan(q[k, 0]):
            continue
        for _ in range(NEWTON_STEPS):
            frames = _joint_frames(q[k : k + 1], X_joints, X_6F)[0]
            if np.abs(_pose_error(frames[6], X_goals[k])).max() < CONVERGED:
                break
            step = _newton_step(frames, X_goals[k])
            q[k] += step * min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12))
        else:
            q[k] = np.nan
