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
from breastscan.robot.joint_motion import NEGLIGIBLE_DISTANCE, braking
from breastscan.robot.ur.targets import SPEED_TOLERANCE
from breastscan.robot.ur.ur5e import PERIOD, SPEED_LIMIT
from sim.controller.curves import BACK, BISECTIONS, RAMP, STRAIGHT, Circle, Pace, arc, parabola
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
STOP_DECELERATION = 10.0
"""Of the leading joint where a motion ends before its end [rad/s^2]."""
END_STEPS = 20
"""In which Newton's method goes from the present joint angles to those at a motion's end."""
NEARING = 0.1
"""Measure of singularity below which joints are watched for their acceleration [-]; assumed."""
LARGEST_ACCELERATION = 40.0
"""Of a joint there, and in a motion at a speed, whatever is asked for [rad/s^2]; assumed."""
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

    def __init__(self, robot: SimRobot, deceleration: float = STOP_DECELERATION) -> None:
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
    """To rest along a line whose joints are a function of the fraction covered; from rest, or round
    a corner out of another one.
    """

    def __init__(
        self,
        start: Float[np.ndarray, "6"],
        length: float,
        joints: Callable[[float, Float[np.ndarray, "6"]], Float[np.ndarray, "6"]],
        position: Callable[[float], Float[np.ndarray, "3"]],
        pace: Pace,
        is_followed: Callable[[float, Float[np.ndarray, "6"]], bool] | None = None,
    ) -> None:
        """From rest.

        Args:
            start: Joint angles at its beginning [rad].
            length: Of the line, as the pace counts it [rad or m].
            joints: (fraction, joint angles near by) -> joint angles there [rad].
            position: Fraction -> where the tool is then, in B [m].
            pace: How fast.
            is_followed: Of a line in space: whether joint angles are on it at a fraction.
        """
        self._start, self._length = start, length
        self._is_followed = is_followed
        self._joints, self._position = joints, position
        self._pace = pace
        self._q = start
        self._law = pace.law(length, length) if length > NEGLIGIBLE_DISTANCE else None
        self._before, self._time = 0.0, 0.0
        """Length before the law begins, and time since then [s]; negative in the corner."""
        self._round = lambda t: start
        self._radius, self._corner_length = 0.0, 0.0
        self._steady = False

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period, of which `scaling` counts."""
        fraction, goes_on = 1.0, False
        if self._law is not None:
            self._time = min(self._time + scaling * PERIOD, self._law.duration)
            fraction = (self._before + self._law.distance(max(self._time, 0.0))) / self._length
            goes_on = bool(self._time < self._law.duration)
        in_corner = self._time < 0
        q = self._round(self._time) if in_corner else self._at(fraction)
        if self._is_followed is not None:
            _check_singularity(*robot.commanded, q)
            if not (in_corner or self._is_followed(fraction, q)):
                raise ImpossibleMotion("the joints cannot follow the line", Cause.SINGULARITY)
        go(robot, q)
        return goes_on

    def blend(self, radius: float, *, steady: bool) -> bool:
        """Let the next motion take over `radius` before the end [m], so far from it in space; if
        `steady`, at the speed of the line. Whether half of the line is enough for that.
        """
        self._radius, self._steady = radius, steady
        self._corner_length = self._length_near(1.0, radius)
        return self._corner_length < self._length / 2

    @property
    def is_taken_over(self) -> bool:
        """Whether the next motion has to come now, lest this one slows down before the corner."""
        if self._law is None or self._time < 0 or self._radius == 0:
            return False
        speed = self._law.speed(self._time)
        braking = speed**2 / (2 * self._law.acceleration) + speed * PERIOD if self._steady else 0.0
        return 0 < self._left <= max(self._corner_length, braking) and speed > 0

    @property
    def end(self) -> Float[np.ndarray, "6"]:
        """Joint angles in which it comes to rest [rad]."""
        q = self._q
        for fraction in np.linspace(1 - self._left / self._length, 1.0, END_STEPS):
            q = self._joints(float(fraction), q)
        return self._joints(1.0, q)

    def come_from(self, first: "Travel") -> "Travel":
        """Round a corner out of a motion that ends where this one begins, and is taken over."""
        assert first._law is not None, "it is under way"
        if self._law is None:  # it is there already
            first._radius = 0.0
            return first
        speed, left = first._law.speed(first._time), first._left
        covered = self._length_near(0.0, first._radius)
        before = min(left, first._corner_length)
        turn = self._turn(first, 1 - before / first._length, covered / self._length)
        if first._steady and STRAIGHT < turn < BACK:
            before = min(before, covered)
            corner = arc(before, speed, turn)
            covered = before
        else:
            before = before if first._steady else left
            covered = min(covered, before * self._pace.top_speed(self._length) / speed)
            corner = parabola(before, covered, speed)

        def round_(t: float) -> Float[np.ndarray, "6"]:
            u = 1 + t / corner.duration
            if u < 0:
                return first._at(1 - (before - u * corner.duration * speed) / first._length)
            first_left, second_covered = corner.progress(u)
            q = first._at(1 - first_left / first._length)
            return q + self._at(second_covered / self._length) - self._start

        self._round, self._before = round_, covered
        self._time = -corner.duration - (left - before) / speed
        rest = self._length - covered
        self._law = self._pace.law(rest, self._length, corner.end_speed)
        return self

    @property
    def time_scaling(self) -> float:
        """Of the time that it is given, how much it takes at least: what is too short is stretched,
        and nothing stops [-].
        """
        if self._law is None or not self._pace.seconds > 0:
            return 1.0
        speed = self._pace.top_speed(self._length) * self.joint_travel_a_unit()
        change = speed / (RAMP * self._pace.seconds)
        return float(max(speed / SPEED_LIMIT, np.sqrt(change / LARGEST_ACCELERATION)))

    def joint_travel_a_unit(self) -> float:
        """Of the joint that moves most along its length [rad/m, or 1]."""
        q, most = self._start, 0.0
        for fraction in np.linspace(0.0, 1.0, END_STEPS + 1)[1:]:
            after = self._joints(float(fraction), q)
            q, most = after, max(most, float(np.abs(after - q).max()))
        return max(most * END_STEPS / max(self._length, NEGLIGIBLE_DISTANCE), 1e-3)

    @property
    def _left(self) -> float:
        if self._law is None or self._time < 0:
            return self._length
        return self._length - self._before - self._law.distance(self._time)

    def _at(self, fraction: float) -> Float[np.ndarray, "6"]:
        self._q = self._joints(fraction, self._q)
        return self._q

    def _length_near(self, end: float, radius: float) -> float:
        """Of the part within `radius` of an end (fraction 0 or 1) in space [m]: half at most."""
        low, high = 0.0, 0.5
        p_B = self._position(end)
        if np.linalg.norm(self._position(0.5) - p_B) <= radius:
            return self._length / 2
        for _ in range(BISECTIONS):
            share = (low + high) / 2
            inside = np.linalg.norm(self._position(abs(end - share)) - p_B) <= radius
            low, high = (share, high) if inside else (low, share)
        return low * self._length

    def _turn(self, first: "Travel", from_fraction: float, to_fraction: float) -> float:
        """By which the tool's direction changes between two motions [rad]."""
        before = first._position(1.0) - first._position(from_fraction)
        behind = self._position(to_fraction) - self._position(0.0)
        return float(se3.angle_between(before, behind))


def joint_travel(
    arm: KinematicCalibration,
    start: Float[np.ndarray, "6"],
    q: Float[np.ndarray, "6"],
    X_FT: Float[np.ndarray, "4 4"],
    pace: Pace,
) -> Travel:
    """Straight in joint space to `q`, with a tool at `X_FT`; the pace is the leading joint's."""

    def joints(fraction: float, near: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        return start + fraction * (q - start)

    def position(fraction: float) -> Float[np.ndarray, "3"]:
        return (arm.forward(joints(fraction, q)) @ X_FT)[:3, 3]

    return Travel(start, float(np.abs(q - start).max()), joints, position, pace)


def straight_travel(
    arm: KinematicCalibration,
    start: Float[np.ndarray, "6"],
    X_BT: Float[np.ndarray, "4 4"],
    X_FT: Float[np.ndarray, "4 4"],
    pace: Pace,
) -> Travel:
    """Straight in space to the tool pose `X_BT`, of a tool at `X_FT`; the pace is the tool's."""
    X_start = arm.forward(start) @ X_FT
    displacement = X_BT[:3, 3] - X_start[:3, 3]
    rotation = se3.rotation_vector(se3.inverse(X_start) @ X_BT)
    turned = ROTATION_LENGTH * float(np.linalg.norm(rotation))
    return _tool_travel(
        arm,
        start,
        X_FT,
        max(float(np.linalg.norm(displacement)), turned),
        lambda fraction: X_start[:3, 3] + fraction * displacement,
        rotation,
        pace,
    )


def circular_travel(
    arm: KinematicCalibration,
    start: Float[np.ndarray, "6"],
    circle: Circle,
    X_FT: Float[np.ndarray, "4 4"],
    pace: Pace,
    X_BT: Float[np.ndarray, "4 4"] | None,
) -> Travel:
    """Along a circle to the orientation of `X_BT`; None keeps it to the tangent as it is."""
    X_start = arm.forward(start) @ X_FT
    axis_T = X_start[:3, :3].T @ (circle.axis * circle.angle)
    rotation = axis_T if X_BT is None else se3.rotation_vector(se3.inverse(X_start) @ X_BT)
    length = circle.radius * circle.angle
    return _tool_travel(arm, start, X_FT, length, circle.point, rotation, pace)


def _tool_travel(
    arm: KinematicCalibration,
    start: Float[np.ndarray, "6"],
    X_FT: Float[np.ndarray, "4 4"],
    length: float,
    position: Callable[[float], Float[np.ndarray, "3"]],
    rotation_T: Float[np.ndarray, "3"],
    pace: Pace,
) -> Travel:
    """Along a line in space, so long, while the tool rotates by a vector in its first frame."""
    X_start, X_TF = arm.forward(start) @ X_FT, se3.inverse(X_FT)

    def pose(fraction: float) -> Float[np.ndarray, "4 4"]:
        X = X_start @ se3.from_rotation_vector(fraction * rotation_T, np.zeros(3))
        X[:3, 3] = position(fraction)
        return X

    def joints(fraction: float, near: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        return arm.step(near, pose(fraction) @ X_TF)

    def is_followed(fraction: float, q: Float[np.ndarray, "6"]) -> bool:
        error = np.abs(arm.forward(q) @ X_FT - pose(fraction))
        return bool(error[:3, 3].max() <= OFF_LINE and error[:3, :3].max() <= OFF_ROTATION)

    return Travel(start, length, joints, position, pace, is_followed)


class JointSpeed:
    """speedj: up or down to joint speeds, and on at them."""

    def __init__(self, qd: Float[np.ndarray, "6"], acceleration: float) -> None:
        self._qd, self._acceleration = qd, min(acceleration, LARGEST_ACCELERATION)

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
        rotation_acceleration: float,
    ) -> None:
        self._arm = arm
        self._p_FT = X_FT[:3, 3]
        self._speed = speed
        self._max_change = acceleration * PERIOD, rotation_acceleration * PERIOD

    def __call__(self, robot: Commanded, scaling: float) -> bool:
        """One period."""
        q, qd = robot.commanded
        J = tool_jacobian(self._arm, q, self._p_FT)
        now = J @ qd
        change = scaling * self._speed - now
        parts = zip(self._max_change, (change[:3], change[3:]), strict=True)
        shares = [most / max(float(np.linalg.norm(part)), 1e-12) for most, part in parts]
        wanted = now + change * min(1.0, *shares)
        qd_next = np.linalg.lstsq(J, wanted, rcond=1e-3)[0]
        # beside a singularity the tool slows down before it is stopped
        q_next = q + PERIOD * qd_next * min(1.0, SPEED_LIMIT / max(np.abs(qd_next).max(), 1e-12))
        _check_singularity(q, qd, q_next)
        change_q = q_next - q - PERIOD * qd
        most = PERIOD**2 * LARGEST_ACCELERATION / max(float(np.abs(change_q).max()), 1e-12)
        go(robot, q + PERIOD * qd + min(1.0, most) * change_q)
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
