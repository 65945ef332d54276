"""How the controller moves the arm: one motion at a time, one call a period.

A motion commands the robot for one period when called, and says whether it goes on.
"""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.geometry.kinematics import singularity_measure
from breastscan.robot.joint_motion import NEGLIGIBLE_DISTANCE, Trapezoid, braking
from breastscan.robot.ur.targets import SPEED_TOLERANCE
from breastscan.robot.ur.ur5e import PERIOD, SPEED_LIMIT
from sim.controller.states import Cause
from sim.robot import SimRobot


@runtime_checkable
class Commanded(Protocol):
    """What a motion moves: the robot, or under force mode what the program makes of it."""

    @property
    def commanded(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """Joint angles as the period ends [rad], and speeds [rad/s]."""
        ...

    def go(self, q: Float[np.ndarray, "6"]) -> None:
        """A period that ends at `q` [rad]."""

    def follow(self, target: Float[np.ndarray, "6"]) -> None:
        """A period of servoj towards `target` [rad]."""


Motion = Callable[[Commanded, float], bool]
"""(what moves, speed scaling) -> whether it goes on."""
ROTATION_LENGTH = 0.3
"""Length that a rotation by a radian counts as in a straight motion of the tool [m]."""
NEARING = 0.1
"""Measure of singularity below which joints are watched for their acceleration [-]; assumed."""
LARGEST_ACCELERATION = 40.0
"""Of a joint there [rad/s^2]; assumed."""
NEAR_SINGULARITY = 0.02
"""Measure of singularity below which no straight motion leads further down [-]; assumed."""
OFF_LINE, OFF_ROTATION = 1e-4, 1e-3
"""That a straight motion's steps may be off their line: [m], elements of the rotation matrix."""
CATCHING_UP = 0.9 * SPEED_LIMIT * PERIOD
"""That a joint makes in a period where servoj's target is far away, so that the servo's overshoot
stays within the speed limit [rad]; assumed."""
YIELD_TIME = 0.2
"""For which joints yield to what has pressed them [s]; assumed."""
LONGEST_STEP = SPEED_TOLERANCE * SPEED_LIMIT * PERIOD
"""That a joint can make in a period [rad]."""


class ImpossibleMotion(Exception):
    """A motion wants of the joints what they cannot do; nothing has moved yet."""

    def __init__(self, text: str, cause: Cause = Cause.SETPOINT) -> None:
        super().__init__(text)
        self.cause = cause


def go(robot: Commanded, q: Float[np.ndarray, "6"]) -> None:
    """One period, to `q` [rad]."""
    step = np.abs(q - robot.commanded[0]).max()
    if not step <= LONGEST_STEP:  # NaN is none either
        raise ImpossibleMotion(
            f"a joint would move by {step:.3g} rad in a period, {LONGEST_STEP:.4f} rad is possible"
        )
    robot.go(q)


def _check_singularity(
    q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"], q_next: Float[np.ndarray, "6"]
) -> None:
    """Refuse a step of a straight motion that comes closer to a singularity than it may, or that
    takes too much of the joints beside one.
    """
    measure = float(singularity_measure(q_next))
    change = np.abs(q_next - q - PERIOD * qd).max()
    jerks = measure < NEARING and not change <= PERIOD**2 * LARGEST_ACCELERATION
    if jerks or not np.abs(q_next - q).max() <= LONGEST_STEP:
        raise ImpossibleMotion(
            f"a joint would be jerked, {measure:.3f} from a singularity", Cause.NEARING
        )
    if measure < NEAR_SINGULARITY and measure < float(singularity_measure(q)):
        raise ImpossibleMotion(
            f"the tool cannot go on straight: {measure:.3f} from a singularity", Cause.SINGULARITY
        )


def hold(robot: Commanded, scaling: float) -> bool:
    """Stay."""
    robot.go(robot.commanded[0])
    return True


class Servo:
    """servoj: towards a target that every call may replace."""

    def __init__(self, q: Float[np.ndarray, "6"]) -> None:
        self.q = q
        self._now: np.ndarray | None = None
        """What is followed: the target, as fast as `scaling` lets it be approached [rad]."""

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        now = robot.commanded[0] if self._now is None else self._now
        step, longest = self.q - now, scaling * CATCHING_UP
        near = np.abs(step).max() <= scaling * LONGEST_STEP
        self._now = self.q if near else now + np.clip(step, -longest, longest)
        robot.follow(self._now)
        return True


class Braking:
    """Along the commanded motion, to rest."""

    def __init__(self, robot: SimRobot, deceleration: float) -> None:
        """At a deceleration of the leading joint [rad/s^2]."""
        self._targets = braking(*robot.commanded, deceleration, PERIOD)

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        target = next(self._targets, None)
        robot.go(robot.commanded[0] if target is None else target)
        return target is not None


class Yielding:
    """Away from what presses the joints: they are braked, and held nowhere."""

    def __init__(self, robot: SimRobot) -> None:
        self._robot, self._left = robot, round(YIELD_TIME / PERIOD)

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        self._robot.resync()
        self._robot.go(self._robot.commanded[0])
        self._left -= 1
        return self._left > 0


class Travel:
    """From rest to rest along a line whose joints are a function of the fraction covered."""

    def __init__(
        self,
        length: float,
        speed: float,
        acceleration: float,
        joints: Callable[[float], Float[np.ndarray, "6"]],
    ) -> None:
        self._joints, self._time = joints, 0.0
        self._profile = (
            Trapezoid(length, speed, acceleration) if length > NEGLIGIBLE_DISTANCE else None
        )
        self._length = length

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period, of which `scaling` counts."""
        if self._profile is None:
            go(robot, self._joints(1.0))
            return False
        self._time = min(self._time + scaling * PERIOD, self._profile.duration)
        go(robot, self._joints(self._profile.distance(self._time) / self._length))
        return self._time < self._profile.duration


def joint_travel(
    robot: SimRobot, q: Float[np.ndarray, "6"], speed: float, acceleration: float
) -> Travel:
    """Straight in joint space to `q`; speed and acceleration of the leading joint [rad/s,
    rad/s^2].
    """
    start = robot.commanded[0]
    return Travel(
        float(np.abs(q - start).max()),
        speed,
        acceleration,
        lambda fraction: start + fraction * (q - start),
    )


def straight_travel(
    robot: SimRobot,
    arm: KinematicCalibration,
    X_BT: Float[np.ndarray, "4 4"],
    X_FT: Float[np.ndarray, "4 4"],
    speed: float,
    acceleration: float,
) -> Travel:
    """Straight in space to the tool pose `X_BT`, of a tool at `X_FT`; speed and acceleration in
    m and s.
    """
    X_start, X_TF = arm.forward(robot.commanded[0]) @ X_FT, se3.inverse(X_FT)
    rotation = se3.rotation_vector(se3.inverse(X_start) @ X_BT)
    displacement = X_BT[:3, 3] - X_start[:3, 3]

    def joints(fraction: float) -> Float[np.ndarray, "6"]:
        X = X_start @ se3.from_rotation_vector(fraction * rotation, np.zeros(3))
        X[:3, 3] = X_start[:3, 3] + fraction * displacement
        before, qd = robot.commanded
        q = arm.step(before, X @ X_TF)
        _check_singularity(before, qd, q)
        error = np.abs(arm.forward(q) @ X_FT - X)
        if not (error[:3, 3].max() <= OFF_LINE and error[:3, :3].max() <= OFF_ROTATION):
            raise ImpossibleMotion("the joints cannot follow the line", Cause.SINGULARITY)
        return q

    length = max(
        float(np.linalg.norm(displacement)), ROTATION_LENGTH * float(np.linalg.norm(rotation))
    )
    return Travel(length, speed, acceleration, joints)


class JointSpeed:
    """speedj: up or down to joint speeds, and on at them."""

    def __init__(self, qd: Float[np.ndarray, "6"], acceleration: float) -> None:
        self._qd, self._acceleration = qd, acceleration

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        q, qd = robot.commanded
        change, max_change = scaling * self._qd - qd, self._acceleration * PERIOD
        largest = float(np.abs(change).max())
        go(robot, q + PERIOD * (qd + change * min(1.0, max_change / max(largest, 1e-12))))
        return True


class ToolSpeed:
    """speedl: the same for the tool's linear and angular velocity in the base."""

    def __init__(
        self,
        arm: KinematicCalibration,
        X_FT: Float[np.ndarray, "4 4"],
        speed: Float[np.ndarray, "6"],
        acceleration: float,
    ) -> None:
        self._arm = arm
        self._p_FT = X_FT[:3, 3]
        self._speed = speed
        self._acceleration = acceleration

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        q, qd = robot.commanded
        J = tool_jacobian(self._arm, q, self._p_FT)
        now = J @ qd
        change, max_change = scaling * self._speed - now, self._acceleration * PERIOD
        largest = max(float(np.linalg.norm(change[:3])), float(np.linalg.norm(change[3:])))
        wanted = now + change * min(1.0, max_change / max(largest, 1e-12))
        qd_next = np.linalg.lstsq(J, wanted, rcond=1e-3)[0]
        # beside a singularity the tool slows down before it is stopped
        q_next = q + PERIOD * qd_next * min(1.0, SPEED_LIMIT / max(np.abs(qd_next).max(), 1e-12))
        _check_singularity(q, qd, q_next)
        go(robot, q_next)
        return True


def tool_jacobian(
    arm: KinematicCalibration, q: Float[np.ndarray, "6"], p_FT: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "6 6"]:
    """From joint speeds to the tool's linear and angular velocity in B, the linear first."""
    J, lever_B = arm.jacobian(q).copy(), arm.forward(q)[:3, :3] @ p_FT
    J[:3] -= cross_matrix(lever_B) @ J[3:]
    return J


def between(
    X_BT: Float[np.ndarray, "4 4"], X_goal: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6"]:
    """The small motion from a pose to another, in B: along [m] and about [rad] the axes."""
    R = se3.pose(X_goal[:3, :3] @ X_BT[:3, :3].T, np.zeros(3))
    return np.concatenate([X_goal[:3, 3] - X_BT[:3, 3], se3.rotation_vector(R)])


def cross_matrix(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Of the cross product with `v` from the left: NumPy's own takes thirty times as long for
    three numbers.
    """
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
