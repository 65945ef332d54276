"""The last look at every command and every measurement before the robot moves.

UR's own force limit is accurate to 25 N, so it cannot guard a contact of 5 N: this does.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError, SafetyError


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """Limits that end a scan."""

    force: float = 15.0
    """Contact force in any direction [N]: three times the usual set-point, a tenth of what DGUV 2011 allows for the
    chest in industrial contact."""
    torque: float = 3.0
    """Moment about the probe tip [N m]: far above what a centred contact makes, so it means that the probe caught."""
    joint_speed: float = 1.0
    """Speed that a command may ask of any joint [rad/s]: a third of the UR5e's own limit."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ConfigError(f"safety.{name} must be positive, not {value}", value)


def check_wrench(wrench_P: Float[np.ndarray, "6"], limits: SafetyLimits) -> None:
    """Pass a wrench [N, N m] that is finite and inside the limits.

    Raises:
        SafetyError: It is not; the caller must retreat.
    """
    if not np.isfinite(wrench_P).all():
        raise SafetyError("the force sensor sent a number that is not finite: check its cable and power", wrench_P)
    force, torque = float(np.linalg.norm(wrench_P[:3])), float(np.linalg.norm(wrench_P[3:]))
    if force > limits.force:
        raise SafetyError(f"contact force {force:.1f} N is above the limit of {limits.force:.1f} N", wrench_P)
    if torque > limits.torque:
        raise SafetyError(f"contact torque {torque:.2f} N m is above the limit of {limits.torque:.2f} N m", wrench_P)


def check_command(
    q: Float[np.ndarray, "6"], q_before: Float[np.ndarray, "6"], period: float, limits: SafetyLimits
) -> None:
    """Pass a joint target [rad] that is finite and reachable from the last one inside one period [s].

    Raises:
        SafetyError: It is not; nothing was sent.
    """
    if not np.isfinite(q).all():
        raise SafetyError("the controller computed a joint target that is not finite", q)
    speed = np.abs(q - q_before) / period
    if speed.max() > limits.joint_speed:
        worst = int(speed.argmax())
        raise SafetyError(
            f"joint {worst + 1} would have to move at {speed[worst]:.2f} rad/s, above the limit of "
            f"{limits.joint_speed:.2f} rad/s: the path is too fast or too close to a singularity",
            q,
        )
