"""What a controller checks in every period: that the arm goes where it is sent, as fast as it may,
and meets nothing.

The controller checks what it commands and ends in a protective stop; the safety system checks what
is measured, a tolerance later, and cuts the power. Codes: [UR-codes]. That there is a limit for
each of these things is in [UR-user-manual]; numbers that no document gives are marked as assumed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from jaxtyping import Float

from breastscan.robot.interface import RobotState
from breastscan.robot.ur.ur5e import ANGLE_LIMIT, PERIOD
from sim.arm.ur5e import JOINTS
from sim.controller import motion
from sim.controller.states import Cause, Safety
from sim.robot import SimRobot

SAFE_DECELERATION = 40.0
"""Of the leading joint in a stop for safety [rad/s^2]; assumed."""
OPERATIONAL = 0.94
"""Share of a speed limit to which the controller slows its own motions, so that joints do the
180°/s of their data sheet; assumed. The limits' tolerances are kept as in [UR-user-manual]."""
RANGE_TOLERANCE = np.deg2rad(3.0)
"""Beyond a joint's range, where the safety system comes in [rad]."""
JOINT_SPEED_TOLERANCE = np.deg2rad(1.15)
"""[rad/s]"""
TOOL_SPEED_TOLERANCE = 0.05
"""[m/s]"""
REACTION = 2 * PERIOD
"""Before a stop begins [s]."""
ROUNDING = 1e-3
"""By which a motion to the very end of a joint's range may pass it [rad]."""
DEVIATION_LIMIT = 0.05
"""Between a joint and its target [rad]; assumed."""
COLLISION_TORQUE = 0.7 * np.array([joint.torque for joint in JOINTS])
"""From outside on a joint [N m]; assumed."""
SHORTEST_LEVER = 0.1
"""Share of the longest lever arm below which the joints do not feel a force on the tool [-]."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Of the safety system in one of its modes."""

    joint_speed: float
    """[rad/s]"""
    tool_speed: float
    """[m/s]"""
    tool_force: float
    """[N]"""


LIMITS = {
    Safety.NORMAL: Limits(joint_speed=np.deg2rad(191.0), tool_speed=1.5, tool_force=150.0),
    Safety.REDUCED: Limits(joint_speed=np.deg2rad(191.0), tool_speed=0.75, tool_force=120.0),
    Safety.RECOVERY: Limits(joint_speed=np.deg2rad(30.0), tool_speed=0.25, tool_force=100.0),
}
"""Of the modes in which the arm moves. Those of recovery are fixed [UR-user-manual], the others are
set up on a robot; here the preset of the installation, assumed."""

Finding = tuple[Cause, int, str]
"""Cause, joint from 0, and what was measured."""


def outside(q: Float[np.ndarray, "6"]) -> bool:
    """Whether a joint is beyond what the safety system allows [rad]."""
    return bool((np.abs(q) > ANGLE_LIMIT + RANGE_TOLERANCE).any())


class Supervision:
    """Compares, period by period."""

    def __init__(self, robot: SimRobot) -> None:
        self._robot, self._pressed = robot, 0
        self.collision_ratio = 0.0
        """Force or torque from outside over what counts as a collision."""
        self.deviation_ratio = [0.0] * 6
        """Distance of each joint from its target over the limit."""
        self.pace = 1.0
        """By which the controller slows its own motions to keep the speed limits."""

    def check(self, limits: Limits, *, recovers: bool) -> Finding | None:
        """What is wrong in the latest period; while the arm `recovers` it may be out of range."""
        robot, state = self._robot, self._robot.state()
        q, qd = robot.commanded
        J = motion.tool_jacobian(robot.calibration, state.q, robot.X_FP[:3, 3])[:3]
        commanded = float(np.abs(qd).max()), float(np.linalg.norm(J @ qd))
        self._keep_pace(max(commanded[0] / limits.joint_speed, commanded[1] / limits.tool_speed))
        self._compare_torques(J, limits.tool_force)
        # the sample is of the period's beginning
        self.deviation_ratio = (np.abs(q - PERIOD * qd - state.q) / DEVIATION_LIMIT).tolist()
        checks = self._check_commanded(q, qd, commanded, limits), self._check_contact()
        measured = self._check_measured(state, float(np.linalg.norm(J @ state.qd)), limits)
        findings = chain(*checks, () if recovers else _check_range(state.q), measured)
        return next(findings, None)

    def _check_commanded(
        self,
        q: Float[np.ndarray, "6"],
        qd: Float[np.ndarray, "6"],
        speeds: tuple[float, float],
        limits: Limits,
    ) -> Iterator[Finding]:
        if not speeds[0] <= limits.joint_speed:  # NaN is none either
            yield Cause.SETPOINT, 0, f"a joint is to move at {speeds[0]:.2f} rad/s"
        if not speeds[1] <= limits.tool_speed:
            yield Cause.SETPOINT, 0, f"the tool is to move at {speeds[1]:.2f} m/s"
        rest = q + qd * (np.abs(qd) / (2 * SAFE_DECELERATION) + REACTION)
        leaves = (np.abs(rest) > ANGLE_LIMIT + ROUNDING) & (rest * qd > 0)
        if leaves.any():
            joint = int(leaves.argmax())
            yield Cause.JOINT_RANGE, 0, f"joint {joint + 1} is about to leave its range"

    def _check_contact(self) -> Iterator[Finding]:
        if self.collision_ratio >= 1.0:
            text = f"{100 * self.collision_ratio:.0f} % of what a collision is"
            yield Cause.COLLISION, self._pressed, text
        largest = max(self.deviation_ratio)
        if largest >= 1.0:
            joint = self.deviation_ratio.index(largest)
            yield Cause.DEVIATION, joint, f"{largest * DEVIATION_LIMIT:.3f} rad off its path"

    def _check_measured(
        self, state: RobotState, tool_speed: float, limits: Limits
    ) -> Iterator[Finding]:
        joint = int(np.abs(state.qd).argmax())
        speed = abs(float(state.qd[joint]))
        if speed > limits.joint_speed + JOINT_SPEED_TOLERANCE:
            yield Cause.JOINT_SPEED_VIOLATED, joint, f"a joint moves at {speed:.2f} rad/s"
        if tool_speed > limits.tool_speed + TOOL_SPEED_TOLERANCE:
            yield Cause.TOOL_SPEED_VIOLATED, 0, f"the tool moves at {tool_speed:.2f} m/s"

    def _keep_pace(self, ratio: float) -> None:
        self.pace = min(1.0, float(self.pace * OPERATIONAL / max(ratio, 1e-9)))

    def _compare_torques(self, J: Float[np.ndarray, "3 6"], tool_force: float) -> None:
        """How much of a collision what presses the arm is, and which joint feels most of it.

        A force on the tool shows in the joints by its lever arms: hardly along the direction in
        which the arm is stretched, as the manual warns.
        """
        torque = self._robot.external_torques()
        ratios = np.abs(torque) / COLLISION_TORQUE
        force = np.linalg.lstsq(J.T, torque, rcond=SHORTEST_LEVER)[0]
        self.collision_ratio = max(float(ratios.max()), float(np.linalg.norm(force)) / tool_force)
        self._pressed = int(ratios.argmax())


def _check_range(q: Float[np.ndarray, "6"]) -> Iterator[Finding]:
    if outside(q):
        yield Cause.RANGE_VIOLATED, 0, f"a joint is at {np.abs(q).max():.3f} rad"
