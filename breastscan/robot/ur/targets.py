"""What no arm of this kind can follow, refused before it is sent."""

import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, SPEED_LIMIT

SPEED_TOLERANCE = 1.05
"""Share of the speed limit above which a servo target counts as a jump."""


def check_angles(q: Float[np.ndarray, "6"]) -> None:
    """Refuse joint angles [rad] that are not finite or beyond the limits.

    Raises:
        RobotError: They are.
    """
    if not np.abs(q).max() <= ANGLE_LIMIT:
        raise RobotError(
            f"joint targets must be finite and stay within +-{ANGLE_LIMIT:.3f} rad, got {q}: "
            "unwind the path",
            q,
        )


def check_step(q: Float[np.ndarray, "6"], before: Float[np.ndarray, "6"], period: float) -> None:
    """Refuse a target too far from the one a period [s] before [rad].

    Raises:
        RobotError: It is.
    """
    step = float(np.abs(q - before).max())
    if step > SPEED_TOLERANCE * SPEED_LIMIT * period:
        raise RobotError(
            f"the servo target jumps by {step:.4f} rad in one period, the joints do "
            f"{SPEED_LIMIT:.2f} rad/s at most: move there with move_joint first",
            q,
        )


def check_motion(speed: float, acceleration: float) -> None:
    """Refuse a speed [rad/s] and an acceleration [rad/s^2] that no motion can have.

    Raises:
        RobotError: They are none.
    """
    if not (0 < speed <= SPEED_LIMIT and acceleration > 0):
        raise RobotError(
            f"move_joint needs a speed in 0 .. {SPEED_LIMIT:.2f} rad/s and a positive "
            f"acceleration, got {speed} rad/s and {acceleration} rad/s^2",
            (speed, acceleration),
        )
