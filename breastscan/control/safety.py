"""The supervisor between every controller and every robot: its limits, and the check of each
command.

UR's own force limit is accurate to 25 N, so it cannot guard a contact of 5 N: this does. It knows
nothing of force laws or plans; it sees what the robot measured (`control.monitor`) and what it
is told to do, and returns the command within its limits, and why it changed it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from breastscan.checks import require_positive
from breastscan.errors import BreastScanError, SafetyError


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """Limits that end a scan in an emergency retreat; each with its reason."""

    force: float = 15.0
    """Contact force in any direction [N]: a tenth of what industry allows for the chest [DGUV]."""
    force_margin: float = 5.0
    """Pressing force above the set-point [N]: what the retreat needs up to 15 N, while the skin
    comes at it with 40 mm/s through the servo's lag, on tissue of 2 kN/m."""
    pull: float = 5.0
    """Force that draws the probe into the tissue [N]: gel does not, so the sensor must be wrong by
    as much."""
    torque: float = 3.0
    """Moment about the probe tip [N m]: far above what a centred contact makes, so it means that
    the probe caught."""
    force_step: float = 6.0
    """Change of the force from one sample to the next [N]: 14 sigma of the noisiest sensor, ten
    times what the fastest approach to a rigid phantom makes."""
    sensor_range: float = 45.0
    """Force beyond which a sensor counts as saturated [N]: nine tenths of the built-in one's 50
    N."""
    frozen_time: float = 0.02
    """Time without a new sample of the sensor, or of the robot's state, while its clock goes on
    [s]: ten periods, in which an approach goes .4 mm."""
    stuck_time: float = 0.05
    """Time for which all six channels may repeat themselves to the last bit while the tip moves
    [s]."""
    stuck_distance: float = 0.2e-3
    """How far the tip must have moved along its axis meanwhile [m]: .1 N on soft tissue, more than
    any sensor rounds."""
    silence: float = 0.03
    """Time for which commands may go out without a new state coming in [s]."""
    lateness: float = 0.015
    """Gap between two states on the robot's clock, beyond a period [s]: half of servoj's lag, in
    which a probe at 25 mm/s goes .4 mm unguided."""
    joint_speed: float = 1.0
    """Speed that a command may ask of any joint [rad/s]: a third of the UR5e's own limit
    [UR-limits]."""
    joint_acceleration: float = 40.0
    """Change of that speed [rad/s^2]: twice what the fastest retreat asks for."""
    workspace_margin: float = 0.03
    """How far the tip may leave the box around the planned path and its clearance [m]."""
    penetration: float = 0.025
    """How far the tip may go beyond the planned skin [m]: planning error 10 mm, breathing 5,
    indentation 10."""
    skin_offset: float = 0.014
    """How far the skin may lie from where it was planned [m]: 10 mm of planning error and 4 of
    breathing. Beyond, the plan is of another scene."""
    skin_speed: float = 0.022
    """How fast it may move along the probe axis [m/s]: breathing makes 8 mm/s, planning errors 10.
    Beyond, the person moves."""
    skin_overspeed_time: float = 0.1
    """For how long it may do so all the same [s]: an edge or a bump passes under the probe
    sooner."""

    def __post_init__(self) -> None:
        require_positive(self, "safety")

    def with_slack(self, slack: float) -> "SafetyLimits":
        """With so many times the patience for states that are late, missing or not sampled anew."""
        return replace(
            self,
            silence=slack * self.silence,
            lateness=slack * self.lateness,
            frozen_time=slack * self.frozen_time,
        )


@dataclass(frozen=True)
class Workspace:
    """The box in B in which the tip may be."""

    low_B: Float[np.ndarray, "3"]
    """[m]"""
    high_B: Float[np.ndarray, "3"]
    """[m]"""

    @staticmethod
    def around(points_B: Float[np.ndarray, "n 3"], margin: float) -> "Workspace":
        """The box around points, widened by a margin [m]."""
        return Workspace(points_B.min(axis=0) - margin, points_B.max(axis=0) + margin)

    def holds(self, p_B: Float[np.ndarray, "3"]) -> bool:
        """Whether a point lies in the box."""
        sides = zip(self.low_B.tolist(), p_B.tolist(), self.high_B.tolist(), strict=True)
        return all(low <= p <= high for low, p, high in sides)


def overspeed_time(speed: float, before: float, limits: SafetyLimits, period: float) -> float:
    """For how long the skin has moved too fast [s], after `before` and a period more at `speed`
    [m/s].
    """
    return before + period if abs(speed) > limits.skin_speed else 0.0


def check_skin(
    offset: float, speed: float, overspeed: float, limits: SafetyLimits
) -> BreastScanError | None:
    """Check the skin, as the force controller estimates it.

    Args:
        offset: Where it is, beyond the planned skin [m].
        speed: How fast it moves along the probe axis [m/s].
        overspeed: For how long it has been too fast [s].
        limits: What is allowed.
    """
    if abs(offset) > limits.skin_offset:
        return SafetyError(
            f"the skin lies {abs(offset) * 1e3:.0f} mm {'below' if offset > 0 else 'above'} where "
            f"it was planned, at most {limits.skin_offset * 1e3:.0f} mm are expected: take new "
            "pictures",
            offset,
        )
    if overspeed > limits.skin_overspeed_time:
        return SafetyError(
            f"the skin moves at {abs(speed) * 1e3:.0f} mm/s, at most {limits.skin_speed * 1e3:.0f} "
            "mm/s are expected: hold the phantom still",
            speed,
        )
    return None


@dataclass(frozen=True)
class JointCommand:
    """What the controller commands, before the supervisor limits it."""

    q: Float[np.ndarray, "6"]
    """Joint target [rad]."""
    tip_B: Float[np.ndarray, "3"]
    """Where it puts the probe tip [m]."""
    depth: float
    """How far that is beyond the planned skin [m]."""


@dataclass(frozen=True)
class Sent:
    """A command within the limits."""

    q: Float[np.ndarray, "6"]
    """Joint target [rad]."""
    step: Float[np.ndarray, "6"]
    """Its difference from the one before [rad]."""
    fault: BreastScanError | None = None
    """Why it is not what was wanted, or why the scan must end with it."""

    @staticmethod
    def resting(q: Float[np.ndarray, "6"]) -> "Sent":
        """A robot at rest at `q` [rad]."""
        return Sent(q.copy(), np.zeros(6))


def limit_command(
    command: JointCommand, before: Sent, workspace: Workspace, limits: SafetyLimits, period: float
) -> Sent:
    """Limit one command.

    A target that is not finite is replaced by the last one, a step that is too fast or changes too
    fast is shortened; both are told as a fault, as are targets outside the workspace or too deep.
    """
    wanted = command.q - before.q
    largest, largest_change = limits.joint_speed * period, limits.joint_acceleration * period**2
    speed, change = _largest(wanted), _largest(wanted - before.step)
    if not math.isfinite(speed):
        why = "the controller computed a joint target that is not finite"
        return Sent(before.q, np.zeros(6), SafetyError(why, command.q))
    if speed <= largest and change <= largest_change:
        return Sent(command.q, wanted, _misplaced(command, workspace, limits))
    step = np.clip(wanted, -largest, largest)
    step = before.step + np.clip(step - before.step, -largest_change, largest_change)
    return Sent(before.q + step, step, _too_fast(wanted, before.step, period, limits))


def _largest(values: Float[np.ndarray, "6"]) -> float:
    """Largest absolute value, in plain Python: quicker than NumPy for six; NaN where there is
    one.
    """
    numbers = values.tolist()
    return max(max(numbers), -min(numbers)) if math.isfinite(sum(numbers)) else math.nan


def _too_fast(
    wanted: Float[np.ndarray, "6"],
    before: Float[np.ndarray, "6"],
    period: float,
    limits: SafetyLimits,
) -> BreastScanError:
    speed, acceleration = np.abs(wanted) / period, np.abs(wanted - before) / period**2
    worst = int(
        np.maximum(speed / limits.joint_speed, acceleration / limits.joint_acceleration).argmax()
    )
    return SafetyError(
        f"joint {worst + 1} would have to move at {speed[worst]:.2f} rad/s and "
        f"{acceleration[worst]:.0f} rad/s^2, the limits are {limits.joint_speed:.2f} and "
        f"{limits.joint_acceleration:.0f}: the path is too fast or too near a singularity",
        wanted,
    )


def _misplaced(
    command: JointCommand, workspace: Workspace, limits: SafetyLimits
) -> BreastScanError | None:
    if not workspace.holds(command.tip_B):
        return SafetyError(
            f"the probe tip would leave its workspace, for {command.tip_B} m in B", command.tip_B
        )
    if command.depth > limits.penetration:
        return SafetyError(
            f"the probe would go {command.depth * 1e3:.0f} mm beyond the planned skin, at most "
            f"{limits.penetration * 1e3:.0f} mm are allowed",
            command.depth,
        )
    return None
