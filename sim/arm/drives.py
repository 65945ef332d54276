"""The joints' drives: what makes the arm be where the controller wants it.

Proportional, integral and velocity feedback, and what the controller knows of its arm fed forward:
speed, viscous friction and inertia, so that a wanted motion needs no error. The integral takes out
what load and dry friction leave, as in every industrial drive. The gains are not published, they
are chosen: as stiff as the strain-wave gears of such joints, critically damped in a middling
posture.
"""

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from breastscan.robot.ur.ur5e import PERIOD
from sim.arm.servo import ServoJ
from sim.arm.ur5e import JOINTS

INTEGRAL_TIME = 0.1
"""Integral time [s]: after it the integral of a constant error equals the error. It hardly changes
the damping."""
STIFFNESS = np.array([joint.stiffness for joint in JOINTS])
FRICTION_FEED = 1 + np.array([joint.viscous / joint.damping for joint in JOINTS])
"""Velocity command over the wanted speed, so that the actuator's gain gives the viscous friction as
well [-]."""
WINDUP = np.array([joint.torque for joint in JOINTS]) / STIFFNESS
"""Integral beyond which the drive would exceed its torque [rad]."""


class Drives:
    """Remembers the integral."""

    def __init__(self) -> None:
        self._integral = np.zeros(len(JOINTS))

    def release(self) -> None:
        """Forget the integral: the joints are not held where it belongs."""
        self._integral[:] = 0.0

    def commands(
        self, wanted: ServoJ, q: Float[np.ndarray, "6"], inertia_torque: Float[np.ndarray, "6"]
    ) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """Commands of the position [rad] and the velocity [rad/s] actuators for one period.

        Args:
            wanted: Where the joints are to be as it begins, and how fast.
            q: Where they are [rad].
            inertia_torque: What the wanted acceleration takes [N m].
        """
        return _commands(self._integral, wanted.q, wanted.qd, wanted.qdd, q, inertia_torque)


@numba.njit(cache=True)
@no_type_check
def _commands(integral, q_wanted, qd_wanted, qdd_wanted, q, inertia_torque):
    """See `Drives.commands`; the integral [rad] is changed in place."""
    position, velocity = np.empty(len(q)), np.empty(len(q))
    for i in range(len(q)):
        grown = integral[i] + (PERIOD / INTEGRAL_TIME) * (q_wanted[i] - q[i])
        integral[i] = min(max(grown, -WINDUP[i]), WINDUP[i])
        position[i] = q_wanted[i] + integral[i] + inertia_torque[i] / STIFFNESS[i]
        # as the period begins
        velocity[i] = FRICTION_FEED[i] * (qd_wanted[i] - PERIOD * qdd_wanted[i])
    return position, velocity
