"""Force mode: along the compliant axes of a task frame the arm gives the forces that it is asked
for, along the others it goes where the program moves it.

What the maker states [UR-script]: the wrench is what the robot applies to its surroundings; type 1
turns the frame's y to point from the tool to the frame's origin, 2 leaves it, 3 turns its x along
the tool's velocity in the frame's x-y plane; a limit is the highest speed along a compliant axis,
and along another the farthest deviation from the program, beyond which the robot stops for
protection. Damping 0 keeps a speed where no force acts, damping 1 takes it quickly; a gain above 1
can be unstable against something hard. The law itself is not published, and what others measured is
its outcome: 0.38 N of mean deviation over 1 to 10 N [Trochimczuk].

Assumed is the simplest law of which all these statements are true, a mass with a damper. Each
period, axis by axis,

    v <- (1 - damping) v + gain (w + f) T / m,    |v| <= limit,

where w is the wrench asked for, f what the wrist sensor says acts on the tool, and T the period;
the mass m is what the arm itself shows at its tool. Assumed as well: force mode counts while a
program plays; the velocity of type 3 is the program's; a wanted y that leaves z no direction of its
own takes the frame's x for it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from breastscan.geometry import se3
from breastscan.robot.ur.ur5e import PERIOD
from sim.arm.servo import ServoJ
from sim.controller import motion
from sim.controller.motion import ImpossibleMotion, Motion
from sim.robot import SimRobot

MASS = 20.0
"""m along an axis [kg]: around the loop the arm with its rotors shows 13 to 40 along the probe,
while the tool keeps its orientation and its place across it."""
INERTIA = MASS * motion.ROTATION_LENGTH**2
"""The same about an axis [kg m^2]."""
NEAREST = 0.010
"""Distance of the tool from the frame's origin that type 1 needs [m] [UR-script]."""
AXES = ("x", "y", "z", "rx", "ry", "rz")
ELSEWHERE = 1e-4
"""Distance from where force mode left the tool that says that it was moved meanwhile, by a pause
or another tool centre point [m], [rad]."""
AT_REST = 1e-4
"""Speed below which type 3 sees no direction [m/s]."""


@dataclass(frozen=True, kw_only=True)
class ForceTask:
    """What `force_mode` is asked for."""

    R_BC: Float[np.ndarray, "3 3"]
    """The frame's orientation."""
    p_BC: Float[np.ndarray, "3"]
    """Its origin [m]."""
    compliant: Bool[np.ndarray, "6"]
    """Axes along and about which force is controlled."""
    wrench_C: Float[np.ndarray, "6"]
    """That the robot applies, force first [N, N m]."""
    type: int
    """1, 2 or 3."""
    limits: Float[np.ndarray, "6"]
    """Compliant: speed [m/s, rad/s]. Else: deviation from the program [m, rad]."""


@dataclass
class ForceGains:
    """Settings that hold until they are set again; the defaults are the maker's."""

    damping: float = 0.005
    """0 to 1 [-]."""
    scaling: float = 1.0
    """0 to 2 [-]."""


class ForceMode:
    """Moves the arm in place of a motion, which moves the program's tool alone."""

    def __init__(self, task: ForceTask, gains: ForceGains) -> None:
        self.task = task
        """Another one may replace it at any time."""
        self._gains = gains
        self._motion: Motion | None = None
        self._program: ServoJ | None = None
        """Where the program has the joints; begun anew, from where they are, with each motion."""
        self._X_sampled: Float[np.ndarray, "4 4"] | None = None
        """Where the tool should have been when the latest sample was taken."""
        self._X_wanted = np.eye(4)
        """Where it should be: what the program and the compliant axes have moved it to."""
        self._R_BC: Float[np.ndarray, "3 3"] | None = None
        """The latest frame of type 3."""

    def move(
        self,
        moving: Motion,
        robot: SimRobot,
        scaling: float,
        X_FT: Float[np.ndarray, "4 4"],
        wrench_B: Float[np.ndarray, "6"],
    ) -> bool:
        """One period of a motion under force mode.

        Args:
            moving: The program's motion.
            robot: The arm.
            scaling: Of the program's speed.
            X_FT: The tool centre point.
            wrench_B: What the sensor says acts on the tool, about that point [N, N m].

        Returns:
            Whether the motion goes on.

        Raises:
            ImpossibleMotion: The tool is too far from where the program has it, or the joints
                cannot follow.
        """
        arm, (q, qd) = robot.calibration, robot.commanded
        X_BT = arm.forward(q) @ X_FT
        if self._program is None or moving is not self._motion:
            self._program, self._motion = robot.programmed(), moving
        if np.abs(motion.between(X_BT, self._X_wanted)).max() > ELSEWHERE:
            self._X_wanted, self._X_sampled = X_BT, None
        self._program.config = robot.servo_config
        X_before = arm.forward(self._program.commanded[0]) @ X_FT
        goes_on = moving(self._program, scaling)
        step_B = motion.between(X_before, arm.forward(self._program.commanded[0]) @ X_FT)

        J = motion.tool_jacobian(arm, q, X_FT[:3, 3])
        R_BC, compliant = self._frame(X_BT, step_B[:3] / PERIOD)
        if self._X_sampled is not None:
            X_actual = arm.forward(robot.state().q) @ X_FT
            self._check(_in_frame(R_BC, motion.between(X_actual, self._X_sampled)))
        self._X_sampled = self._X_wanted

        speed_C = self._comply(_in_frame(R_BC, J @ qd), _in_frame(R_BC, wrench_B))
        step_C = np.where(compliant, PERIOD * speed_C, _in_frame(R_BC, step_B))
        self._X_wanted = _moved(self._X_wanted, _in_frame(R_BC.T, step_C))
        motion.go(
            robot, q + np.linalg.lstsq(J, motion.between(X_BT, self._X_wanted), rcond=1e-3)[0]
        )
        return goes_on

    def _comply(
        self, speed_C: Float[np.ndarray, "6"], measured_C: Float[np.ndarray, "6"]
    ) -> Float[np.ndarray, "6"]:
        """The law: the next speed [m/s, rad/s] along and about all axes."""
        error_C = self.task.wrench_C + measured_C
        gain = self._gains.scaling * PERIOD / np.repeat([MASS, INERTIA], 3)
        speed_C = (1 - self._gains.damping) * speed_C + gain * error_C
        return np.clip(speed_C, -self.task.limits, self.task.limits)

    def _frame(
        self, X_BT: Float[np.ndarray, "4 4"], velocity_B: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "3 3"], Bool[np.ndarray, "6"]]:
        """The task frame's present orientation, and its compliant axes: none while type 3 has
        seen no motion.
        """
        R_BC, compliant = self.task.R_BC, self.task.compliant
        if self.task.type == 1:
            return _pointing(R_BC, self.task.p_BC - X_BT[:3, 3]), compliant
        if self.task.type == 2:
            return R_BC, compliant
        z_B = R_BC[:, 2]
        along_B = velocity_B - (velocity_B @ z_B) * z_B
        speed = float(np.linalg.norm(along_B))
        if speed > AT_REST:
            x_B = along_B / speed
            self._R_BC = np.stack([x_B, np.cross(z_B, x_B), z_B], axis=1)
        return (R_BC, np.zeros(6, bool)) if self._R_BC is None else (self._R_BC, compliant)

    def _check(self, deviation_C: Float[np.ndarray, "6"]) -> None:
        """How far the tool is from where the program had it, along the axes that are not
        compliant.
        """
        over = np.abs(deviation_C) - self.task.limits
        over[self.task.compliant] = 0.0
        if over.max() > 0:
            axis = int(over.argmax())
            unit = "mm" if axis < 3 else "mrad"
            raise ImpossibleMotion(
                f"force mode: the tool is {1e3 * abs(deviation_C[axis]):.3g} {unit} off the "
                f"program's path in {AXES[axis]}, {1e3 * self.task.limits[axis]:.3g} are allowed"
            )


def _pointing(
    R_BC: Float[np.ndarray, "3 3"], to_origin_B: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """The frame with y along a vector, and z as near to its own as that leaves it."""
    distance = float(np.linalg.norm(to_origin_B))
    if distance < NEAREST:
        raise ImpossibleMotion(
            f"force mode, type 1: the tool is {1e3 * distance:.1f} mm from the frame's origin, "
            f"{1e3 * NEAREST:.0f} mm are needed for a direction"
        )
    y_B = to_origin_B / distance
    for candidate_B in (R_BC[:, 2], R_BC[:, 0]):
        z_B = candidate_B - (candidate_B @ y_B) * y_B
        if np.linalg.norm(z_B) > 1e-3:
            break
    z_B /= np.linalg.norm(z_B)
    return np.stack([np.cross(y_B, z_B), y_B, z_B], axis=1)


def _moved(X_BT: Float[np.ndarray, "4 4"], step_B: Float[np.ndarray, "6"]) -> np.ndarray:
    """A pose after a small motion along and about the axes of B."""
    X = se3.from_rotation_vector(step_B[3:], np.zeros(3)) @ X_BT
    X[:3, 3] = X_BT[:3, 3] + step_B[:3]
    return X


def _in_frame(
    R_BC: Float[np.ndarray, "3 3"], vectors_B: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "6"]:
    """Two vectors of B in the axes of C."""
    return (vectors_B.reshape(2, 3) @ R_BC).ravel()
