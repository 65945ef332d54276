# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The UR5e in MuJoCo, driven as the hardware is: joint targets every control period."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.geometry import se3
from breastscan.robot.interface import RobotState
from sim.joint_motion import braking, trapezoid
from sim.probe import payload
from sim.scene import HOME_Q, PERIOD, Scene
from sim.tissue import Contact, SoftTissue
from sim.truth_log import TruthLog, TruthRecorder
from sim.ur5e import ANGLE_LIMIT, SPEED_LIMIT, joint_names
from sim.wrench_sensor import WrenchSensor, moment

SPEED_TOLERANCE = 1.05
"""Share of the speed limit above which a servo target counts as a jump."""
DIVERGED_SPEED = 10 * SPEED_LIMIT
"""Joint speed that no command can cause [rad/s]."""
STOP_DECELERATION = 4.0
"""Deceleration of the leading joint on `stop` [rad/s^2]."""
ARRIVED = 2e-4
"""Joint error within which a motion has arrived [rad]."""
SETTLE_TIME = 1.0
"""Longest wait for a motion to arrive [s]."""
TARE_TIME = 0.2
"""Time over which `tare` averages the sensor's noise [s]."""


class SimRobot:
    """Implements `breastscan.robot.interface.Robot` in the twin; simulated time passes only while a call runs.

    A sample holds what was true when the forces of the latest period were computed: pose, speed, wrench and truth
    belong to the same instant.
    """

    def __init__(self, scene: Scene, tissue: SoftTissue | None = None, q: Float[np.ndarray, "6"] = HOME_Q) -> None:
        """Switch the arm on.

        Args:
            scene: Where it stands.
            tissue: What the probe presses; None for an arm in free space.
            q: Joint angles to start from [rad].
        """
        self._model = scene.physics
        self._data = mujoco.MjData(self._model)
        self._tissue = tissue
        self._X_SB = se3.inverse(scene.X_BS)
        self._X_FP = scene.X_FP
        self._tool = self._data.body("tool")
        self._tip = self._data.site("tip")
        self._flange = self._data.body("flange")
        self._joints = np.array([self._model.joint(name).qposadr[0] for name in joint_names()])
        self._sensor = WrenchSensor(scene.config.wrist, payload(scene.config.mount_angle), scene.X_FP)
        self._truth = TruthRecorder()
        self._contact: Contact | None = None
        self._after_period: Callable[[], None] = lambda: None
        self._target = np.array(q, float)
        self._target_speed = np.zeros(6)
        self._data.qpos[self._joints] = q
        self._advance(self._target)

    @property
    def period(self) -> float:
        """Control period [s]."""
        return PERIOD

    @property
    def X_FP(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the probe tip in the flange."""
        return self._X_FP

    def state(self) -> RobotState:
        """The latest sample."""
        return self._sample

    @property
    def contact(self) -> Contact | None:
        """What the tissue did to the probe in the latest period; None without tissue."""
        return self._contact

    def watch(self, after_period: Callable[[], None]) -> None:
        """Call `after_period` at the end of every period; no simulated time passes while it runs."""
        self._after_period = after_period

    def truth_log(self) -> TruthLog:
        """What really happened so far, one row a period."""
        return self._truth.log()

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Track `q` [rad] for one period, at the speed that leads there from the previous target.

        Raises:
            RobotError: The target is not finite, outside the joint limits, or too far from the previous one.
        """
        self._check_target(q)
        jump = np.abs(q - self._target).max() / PERIOD
        if jump > SPEED_TOLERANCE * SPEED_LIMIT:
            raise RobotError(
                f"the servo target jumps by {jump * PERIOD:.4f} rad in one period, the joints do {SPEED_LIMIT:.2f} "
                "rad/s at most: move there with move_joint first",
                q,
            )
        self._advance(q)

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Move to `q` [rad] on a straight line in joint space and wait until there.

        Raises:
            RobotError: The target is out of reach, speed or acceleration are not positive, or the arm does not arrive.
        """
        self._check_target(q)
        if not (0 < speed <= SPEED_LIMIT and acceleration > 0):
            raise RobotError(
                f"move_joint needs a speed in 0 .. {SPEED_LIMIT:.2f} rad/s and a positive acceleration, got {speed} "
                f"rad/s and {acceleration} rad/s^2",
                (speed, acceleration),
            )
        for target in trapezoid(self._target, q, speed, acceleration, PERIOD):
            self._advance(target)
        self._settle()

    def tare(self) -> None:
        """Hold still for `TARE_TIME` and take the mean wrench as zero."""
        wrenches = []
        for _ in range(round(TARE_TIME / PERIOD)):
            self._advance(self._target)
            wrenches.append(self._sample.wrench_P)
        zero_P = np.mean(wrenches, axis=0)
        self._sensor.tare(zero_P)
        self._sample = replace(self._sample, wrench_P=self._sample.wrench_P - zero_P)

    def stop(self) -> None:
        """Brake along the present course and stay there."""
        for target in braking(self._target, self._target_speed, STOP_DECELERATION, PERIOD):
            self._advance(target)
        self._settle()

    def snapshot(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 3"] | None, float]:
        """Joint angles [rad], deformed skin in S [m] (None without tissue) and time [s], as a camera would see them."""
        skin_S = None if self._tissue is None else self._tissue.deformed_skin()
        return self._sample.q, skin_S, self._sample.time

    def _check_target(self, q: Float[np.ndarray, "6"]) -> None:
        if not np.isfinite(q).all():
            raise RobotError(f"a joint target must be finite, got {q}", q)
        if np.abs(q).max() > ANGLE_LIMIT:
            raise RobotError(f"joint targets must stay within +-{ANGLE_LIMIT:.3f} rad, got {q}: unwind the path", q)

    def _settle(self) -> None:
        """Hold the target until the joints are there."""
        for _ in range(round(SETTLE_TIME / PERIOD)):
            self._advance(self._target)
            if np.abs(self._sample.q - self._target).max() < ARRIVED:
                return
        error = np.abs(self._sample.q - self._target).max()
        raise RobotError(
            f"the arm does not arrive: {error:.4f} rad off after {SETTLE_TIME} s, something holds it", error
        )

    def _advance(self, target: Float[np.ndarray, "6"]) -> None:
        """One period towards `target`: sense, press, log, integrate."""
        data = self._data
        self._target_speed = (target - self._target) / PERIOD
        self._target = np.array(target, float)
        data.ctrl[0::2], data.ctrl[1::2] = self._target, self._target_speed  # position and velocity servos alternate
        mujoco.mj_step1(self._model, data)
        time, q, qd = data.time, data.qpos[self._joints], data.qvel[self._joints]
        self._press(time, q)
        mujoco.mj_step2(self._model, data)
        on_sensor_F = -data.sensordata[:6]  # MuJoCo gives what the sensor does to the tool
        wrench_P = self._sensor.measure(on_sensor_F, self._flange.xmat.reshape(3, 3))
        self._sample = RobotState(time=time, q=q, qd=qd, wrench_P=wrench_P)
        if not np.abs(data.qvel).max() < DIVERGED_SPEED:
            raise RobotError(f"the simulation diverged at {time:.3f} s: joint speeds {data.qvel} rad/s", time)
        self._after_period()

    def _press(self, time: float, q: Float[np.ndarray, "6"]) -> None:
        """Let the tissue push the probe where it is now, and write the truth down."""
        X_SP = self._X_SB @ se3.pose(self._tip.xmat.reshape(3, 3), self._tip.xpos)
        if self._tissue is None:
            self._truth.add(time, q, np.zeros(3), 0.0, X_SP)
            return
        contact = self._contact = self._tissue.press(X_SP, self._X_SB[:3, :3] @ self._tip_velocity())
        force_B = contact.force_S @ self._X_SB[:3, :3]
        torque_B = contact.torque_S @ self._X_SB[:3, :3]
        self._tool.xfrc_applied[:3] = force_B
        self._tool.xfrc_applied[3:] = torque_B + moment(self._tip.xpos - self._tool.xipos, force_B)
        self._truth.add(time, q, contact.force_S, contact.depth, X_SP)

    def _tip_velocity(self) -> Float[np.ndarray, "3"]:
        """Velocity of the tip in B [m/s]."""
        spatial = np.zeros(6)
        mujoco.mj_objectVelocity(self._model, self._data, mujoco.mjtObj.mjOBJ_SITE, self._tip.id, spatial, 0)
        return spatial[3:]
