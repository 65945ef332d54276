"""Motions in which the drives give torques and hold no position: freedrive, and the torques that a
program asks for.

What they have in common is `SimRobot.exert`: the weight of the arm and of the payload that is set
is lifted, so a wrong payload sinks or rises, and what pushes the arm moves it.

Freedrive: the maker says which axes of a feature are free and that the arm can then be moved by
hand [UR-script]. How the others are held, and that the drives do nothing about the joints' friction
meanwhile, is assumed: friction brings the arm to rest, and a critically damped spring, of the
inertia that the arm shows in these directions, keeps the others.
"""

import numpy as np
from jaxtyping import Bool, Float

from sim.arm.ur5e import JOINTS
from sim.controller import motion
from sim.controller.motion import Braking, Commanded
from sim.robot import SimRobot

HOLDING = 100.0
"""Of the spring that keeps the axes that are not free [rad/s]."""
SINGULAR, NEARLY_SINGULAR = 0.03, 0.06
"""Smallest singular value of the tool's Jacobian, rotations by `ROTATION_LENGTH`, below which
freedrive along chosen axes resists and warns [m]. Assumed."""
VISCOUS = np.array([joint.viscous for joint in JOINTS])
DRY = np.array([joint.dry for joint in JOINTS])
CREEPING = 0.01
"""Joint speed from which dry friction is compensated in full [rad/s]: below, its sign is noise."""


class Freedrive:
    """The arm can be moved by hand."""

    def __init__(
        self,
        robot: SimRobot,
        X_FT: Float[np.ndarray, "4 4"],
        free: Bool[np.ndarray, "6"],
        R_BC: Float[np.ndarray, "3 3"],
    ) -> None:
        """Begin where the arm is.

        Args:
            robot: The arm.
            X_FT: The tool centre point.
            free: Along and about which axes of the feature the tool is free.
            R_BC: The feature's orientation.
        """
        self._robot, self._X_FT = robot, X_FT
        self.constrained = not free.all()
        """Whether some axis is held."""
        self._held = np.kron(np.eye(2), R_BC.T)[~free]
        """Directions of B that are."""
        self._X_start = robot.calibration.forward(robot.commanded[0]) @ X_FT

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        self._robot.exert(self._holding() if self.constrained else np.zeros(6))
        return True

    def _holding(self) -> Float[np.ndarray, "6"]:
        """Torques of the spring along the axes that are not free [N m]: J^T M_x (w^2 e - 2 w v)."""
        arm, (q, qd) = self._robot.calibration, self._robot.commanded
        J = self._held @ motion.tool_jacobian(arm, q, self._X_FT[:3, 3])
        error = self._held @ motion.between(arm.forward(q) @ self._X_FT, self._X_start)
        inertia = np.linalg.pinv(J @ np.linalg.solve(self._robot.mass_matrix(), J.T), rcond=1e-3)
        return J.T @ inertia @ (HOLDING**2 * error - 2 * HOLDING * J @ qd)


class DirectTorque:
    """direct_torque: a period of it, after which the joints are held again unless another
    follows.
    """

    def __init__(
        self,
        robot: SimRobot,
        torque: Float[np.ndarray, "6"],
        viscous_scale: Float[np.ndarray, "6"],
        coulomb_scale: Float[np.ndarray, "6"],
    ) -> None:
        """Torques beside those that lift the arm [N m], and the parts of its friction that the
        drives make up for.
        """
        self._robot, self._torque = robot, torque
        self._viscous, self._dry = viscous_scale * VISCOUS, coulomb_scale * DRY
        self._braking: Braking | None = None

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        if self._braking is not None:
            return self._braking(robot, scaling)
        qd = self._robot.commanded[1]
        friction = self._viscous * qd + self._dry * np.clip(qd / CREEPING, -1.0, 1.0)
        self._robot.exert(self._torque + friction)
        self._braking = Braking(self._robot)
        return True


def singularity(J: Float[np.ndarray, "6 6"]) -> int:
    """0 away from singular postures, 1 near one, 2 so near that freedrive along axes resists."""
    scale = np.repeat([1.0, motion.ROTATION_LENGTH], 3)
    smallest = np.linalg.svd(scale[:, None] * J, compute_uv=False)[-1]
    return int(smallest < NEARLY_SINGULAR) + int(smallest < SINGULAR)
