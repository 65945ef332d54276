"""What the arm keeps to: joint angles and their rates, distance from singularities, table,
surroundings and itself.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from breastscan.checks import require_positive
from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry import kinematics
from breastscan.planning.roll_graph import BlockedError

VIOLATIONS = (
    "out of reach",
    "beyond the elbow's limit",
    "too near a singularity",
    "below the floor",
)
"""Limits that a configuration can violate, in the order of `violations`."""

RATES = (("angle", "rad"), ("speed", "rad/s"), ("acceleration", "rad/s^2"), ("jerk", "rad/s^3"))
"""What is limited for each joint, and its unit: the angle and its derivatives."""
PLANS_SHARE = 0.4
"""Of the supervisor's limits of speed and acceleration, what a retreat must leave to the plan."""


@dataclass(frozen=True, kw_only=True)
class Corrections:
    """What the controller may add to the plan, and what the supervisor lets pass of both
    together.
    """

    pressing_speed: float
    """Largest speed of the force's correction along the probe axis [m/s]."""
    retreat_speed: float
    """Of the fastest retreat along it [m/s]."""
    retreat_acceleration: float
    """Of that [m/s^2]."""
    stop_time: float
    """Time in which the path's own speed goes to 0 meanwhile [s]."""
    joint_speed: float
    """Largest joint speed of a command [rad/s]."""
    joint_acceleration: float
    """Largest joint acceleration of one [rad/s^2]."""

    def fit(self, gains: Float[np.ndarray, "n 6"]) -> Bool[np.ndarray, "n"]:
        """Whether they leave a share to the plan, with so much motion of each joint per motion
        along the axis [rad/m].
        """
        share, fastest = 1.0 - PLANS_SHARE, max(self.retreat_speed, self.pressing_speed)
        largest = gains.max(axis=1)
        return (largest * fastest <= share * self.joint_speed) & (
            largest * self.retreat_acceleration <= share * self.joint_acceleration
        )

    def time_scaling(
        self, q: Float[np.ndarray, "n 6"], period: float, gains: Float[np.ndarray, "n 6"]
    ) -> float:
        """Factor by which a trajectory [rad], one sample a period [s], must take longer so that
        plan and corrections together keep the supervisor's limits; 1 at least.
        """
        speed = np.abs(np.gradient(q, period, axis=0))
        acceleration = np.abs(np.gradient(np.gradient(q, period, axis=0), period, axis=0))
        # once a retreat has its speed, the path's own has gone down by as much
        passed = min(self.retreat_speed / self.retreat_acceleration / self.stop_time, 1.0)
        asked = (
            (speed, self.joint_speed - gains * self.pressing_speed),
            (speed * (1.0 - passed), self.joint_speed - gains * self.retreat_speed),
            (
                speed / self.stop_time + acceleration,
                self.joint_acceleration - gains * self.retreat_acceleration,
            ),
        )
        return max(1.0, *(float((wanted / left).max()) for wanted, left in asked))


@dataclass(frozen=True, kw_only=True)
class LimitUse:
    """The sample of a trajectory that comes closest to a limit."""

    limit: str
    """What is limited, in the words of `RATES`."""
    unit: str
    joint: int
    """Which joint, 1 to 6."""
    sample: int
    """Where along the trajectory."""
    value: float
    """What the joint has there, in `unit`."""
    bound: float
    """What it may have in either direction, in `unit`."""

    @property
    def fraction(self) -> float:
        """Fraction of the limit that is used; above 1 it is broken."""
        return abs(self.value) / self.bound


@dataclass(frozen=True, kw_only=True)
class JointPathConfig:
    """Limits and freedoms of the joint path; the defaults are the UR5e's (Universal Robots,
    `joint_limits.yaml`).
    """

    position_limit: float = 2 * math.pi
    """Joint angle in either direction [rad]."""
    elbow_limit: float = math.pi
    """Joint 3, in either direction [rad]."""
    speed_limit: float = math.pi
    """Joint speed [rad/s]."""
    acceleration_limit: float = 10.0
    """Joint acceleration [rad/s^2]."""
    jerk_limit: float = 100.0
    """Joint jerk [rad/s^3]: full acceleration is reached in a tenth of a second. Universal Robots
    states none."""
    position_margin: float = math.radians(5.0)
    """Kept from the position limits [rad]."""
    singularity_margin: float = 0.1
    """Minimum `kinematics.singularity_measure` [-]."""
    floor: float = 0.05
    """Minimum height of elbow, wrist and flange over the base [m]: half a link above the table."""
    collision_margin: float = 0.01
    """Minimum distance of the arm and its tool from themselves and from what stands around [m]."""
    body_margin: float = 0.005
    """Minimum distance of the arm and its tool, but the probe's face, from the body as it was seen
    [m]."""
    pressed_depth: float = 0.008
    """How far beyond the planned skin the tip is taken to press then [m]: what the softest tissue,
    20 kPa, gives way to 5 N."""
    yielding: float = 0.03
    """Radius around the touched place within which the skin is not kept clear of [m]: as far as the
    face reaches, it pushes the skin away from what is behind it."""
    largest_tilt: float = math.radians(10.0)
    """How far the probe may lean from the normal where no roll helps [rad]."""
    roll_tolerance: float = math.pi / 2
    """How far the array may roll away from lying across the path [rad]: 0 keeps it there, pi / 2
    and more sets the roll free. Free is the default, because the joints move least; a probe mounted
    at 45 degrees stays across the path even so."""
    clearance: float = 0.05
    """Distance from the skin, along the normal, of the poses before and after the path [m]."""

    def __post_init__(self) -> None:
        ranges = {
            "position_margin": (0.0, 0.99 * min(self.position_limit, self.elbow_limit)),
            "singularity_margin": (0.0, 0.99),
            "roll_tolerance": (0.0, math.pi),
            "collision_margin": (0.0, 0.5),
            "body_margin": (0.0, 0.5),
            "pressed_depth": (0.0, 0.05),
            "yielding": (0.0, 0.2),
            "largest_tilt": (0.0, math.pi / 4),
            "floor": (-2.0, 2.0),
        }
        require_positive(self, "planning.joints", but=tuple(ranges))
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                option = f"planning.joints.{name}"
                raise ConfigError(
                    f"{option} must lie between {low:.4g} and {high:.4g}, not {value}", value
                )

    @property
    def reachable_angles(self) -> Float[np.ndarray, "6"]:
        """Largest angle of each joint, margin kept [rad]."""
        limits = np.full(6, self.position_limit)
        limits[2] = self.elbow_limit
        return limits - self.position_margin


def violations(q: Float[np.ndarray, "*b 6"], config: JointPathConfig) -> Bool[np.ndarray, "4 *b"]:
    """Which of `VIOLATIONS` each configuration [rad] commits; NaN counts as out of reach.

    Only the elbow's position is checked: the other joints have full rotations to choose from.
    """
    heights = kinematics.link_heights(q)[..., 2:]  # from the elbow to the flange
    return np.stack(
        [
            np.isnan(q[..., 0]),
            np.abs(q[..., 2]) > config.reachable_angles[2],
            kinematics.singularity_measure(q) < config.singularity_margin,
            heights.min(axis=-1) < config.floor,
        ]
    )


def elbow_down(q: Float[np.ndarray, "*b 6"]) -> Bool[np.ndarray, "*b"]:
    """Whether the elbow hangs below the line from shoulder to wrist."""
    heights = kinematics.link_heights(q)[..., 1:4]
    return np.asarray(heights[..., 1] < (heights[..., 0] + heights[..., 2]) / 2.0)


def limit_uses(
    q: Float[np.ndarray, "n 6"], period: float, config: JointPathConfig
) -> list[LimitUse]:
    """How much of each limit a joint trajectory [rad], one sample a period [s], takes, and where
    it takes most.
    """
    rates = [q, *(np.diff(q, order, axis=0) / period**order for order in (1, 2, 3))]
    bounds = [
        config.reachable_angles,
        np.full(6, config.speed_limit),
        np.full(6, config.acceleration_limit),
        np.full(6, config.jerk_limit),
    ]
    return [
        _use(name, unit, *both)
        for (name, unit), both in zip(RATES, zip(rates, bounds, strict=True), strict=True)
    ]


def time_scaling(uses: list[LimitUse]) -> float:
    """Factor by which the trajectory must take longer to keep the limits of speed, acceleration and
    jerk; 1 at least.

    Taking k times as long divides speeds by k, accelerations by k^2 and jerks by k^3.
    """
    _, *rates = uses
    return max(1.0, *(use.fraction ** (1.0 / order) for order, use in enumerate(rates, start=1)))


def check_trajectory(q: Float[np.ndarray, "n 6"], period: float, config: JointPathConfig) -> None:
    """Pass a joint trajectory [rad], one sample a period [s], that keeps every limit but those of
    the rates.

    Raises:
        BlockedError: A joint passes its limit of angle; it is named, with the sample and the cure.
        PlanningError: Another limit is broken.
    """
    angle = limit_uses(q, period, config)[0]
    if angle.fraction > 1.0:
        error = BlockedError(
            f"joint {angle.joint} would pass its limit of {angle.bound:.2f} rad with "
            f"{angle.value:.2f} rad at sample {angle.sample} of {len(q)}: start elsewhere on the "
            "loop, or run it the other way round",
            angle.value,
        )
        passed = np.abs(q[:, angle.joint - 1]) > angle.bound
        error.reached = max(int(np.argmax(passed)) - 1, 0) / len(q)
        raise error
    against = violations(q, config)
    if against.any():
        kind, sample = (int(index) for index in np.argwhere(against)[0])
        raise PlanningError(
            f"sample {sample} of {len(q)} comes {VIOLATIONS[kind]}: move the phantom a little",
            sample,
        )


def correction_gains(
    q: Float[np.ndarray, "n 6"], X_FP: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 6"]:
    """Motion of each joint, either way, per motion of the probe along its axis [rad/m]."""
    axis_B = kinematics.forward(q)[:, :3, :3] @ X_FP[:3, 2]
    twist = np.concatenate([axis_B, np.zeros_like(axis_B)], axis=1)
    moved = np.linalg.solve(kinematics.jacobian(q), twist[..., None])[..., 0]
    return np.abs(moved)


def _use(limit: str, unit: str, values: np.ndarray, bounds: np.ndarray) -> LimitUse:
    sample, joint = (
        int(index) for index in np.unravel_index(np.argmax(np.abs(values) / bounds), values.shape)
    )
    return LimitUse(
        limit=limit,
        unit=unit,
        joint=joint + 1,
        sample=sample,
        value=float(values[sample, joint]),
        bound=float(bounds[joint]),
    )
