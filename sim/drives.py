"""The joints' drives: what makes the arm be where the controller wants it.

Proportional, integral and velocity feedback, and what the controller knows of its arm fed forward: speed, viscous
friction and inertia, so that a wanted motion needs no error. The integral takes out what load and dry friction leave,
as in every industrial drive. The gains are not published, they are chosen: as stiff as the strain-wave gears of such
joints, critically damped in a middling posture.
"""

import numpy as np
from jaxtyping import Float

from sim.servo import PERIOD
from sim.ur5e import JOINTS

INTEGRAL_TIME = 0.1
"""Time in which the integral answers as much as the position's error does [s]: the damping hardly notices it."""
STIFFNESS = np.array([joint.stiffness for joint in JOINTS])
FRICTION_FEED = 1 + np.array([joint.viscous / joint.damping for joint in JOINTS])
"""Velocity command over the wanted speed, so that the actuator's gain gives the viscous friction as well [-]."""
WINDUP = np.array([joint.torque for joint in JOINTS]) / STIFFNESS
"""Integral beyond which the drive would exceed its torque [rad]."""


class Drives:
    """Remembers the integral."""

    def __init__(self) -> None:
        self._integral = np.zeros(len(JOINTS))

    def commands(
        self,
        q_wanted: Float[np.ndarray, "6"],
        qd_wanted: Float[np.ndarray, "6"],
        q: Float[np.ndarray, "6"],
        inertia_torque: Float[np.ndarray, "6"],
    ) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """Commands of the position [rad] and the velocity [rad/s] actuators for one period.

        Args:
            q_wanted: Where the joints are to be now [rad].
            qd_wanted: How fast they are to move now [rad/s].
            q: Where they are [rad].
            inertia_torque: What the wanted acceleration takes [N m].
        """
        grown = self._integral + (PERIOD / INTEGRAL_TIME) * (q_wanted - q)
        self._integral = np.minimum(np.maximum(grown, -WINDUP), WINDUP)
        return q_wanted + self._integral + inertia_torque / STIFFNESS, qd_wanted * FRICTION_FEED
