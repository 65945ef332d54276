# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The UR5e in MuJoCo, driven as the hardware is: joint targets every control period."""

import copy
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.geometry import se3
from breastscan.robot.interface import RobotState
from breastscan.robot.joint_motion import braking, trapezoid
from breastscan.robot.payload import Payload
from breastscan.robot.ur import targets
from breastscan.robot.ur.ur5e import PERIOD
from breastscan.servo import Servo
from sim.arm import divergence
from sim.arm.drives import STIFFNESS, Drives
from sim.arm.servo import ServoConfig, ServoJ
from sim.arm.ur5e import JOINTS, joint_names
from sim.room.rigid_contacts import rigid_contact
from sim.scene import HOME_Q, Scene
from sim.tissue.breathing import rise, rising_speed
from sim.tissue.contact import Contact, Mechanics
from sim.truth_log import TruthLog, TruthRecorder
from sim.wrist.probe import payload
from sim.wrist.wrench_sensor import GRAVITY_W, WrenchSensor

STOP_DECELERATION = 4.0
"""Deceleration of the leading joint on `stop` [rad/s^2]."""
ARRIVED = 2e-4
"""Joint error within which a motion has arrived [rad]."""
SETTLE_TIME = 1.0
"""Longest wait for a motion to arrive [s]."""
TARE_TIME = 0.2
"""Time over which `tare` averages the sensor's noise [s]."""
NOTHING = np.zeros(3)
"""Force of the tissue in free space [N]."""
BODY, SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE


class SimRobot:
    """Implements `breastscan.robot.interface.Robot` in the twin; simulated time passes only while a
    call runs.

    A sample holds what was true when the forces of the latest period were computed: pose, speed,
    wrench and truth belong to the same instant.
    """

    period = PERIOD
    """Control period [s]."""

    def __init__(
        self, scene: Scene, tissue: Mechanics | None = None, q: Float[np.ndarray, "6"] = HOME_Q
    ) -> None:
        """Switch the arm on.

        Args:
            scene: Where it stands.
            tissue: What the probe presses; None for an arm in free space.
            q: Joint angles to start from [rad].
        """
        self._model = scene.physics
        self._data = mujoco.MjData(self._model)
        self._tissue = tissue
        self._X_BS = scene.X_BS
        self._X_SB = se3.inverse(scene.X_BS)
        self._breathing = scene.config.breathing
        self.X_FP = scene.X_FP
        """Pose of the probe tip in the flange."""
        self._look_up()
        self._tool = self._told_payload = payload(scene.config.mount_angle)
        self._sensor = WrenchSensor(scene.config.wrist, self._tool, scene.X_FP)
        self._truth = TruthRecorder()
        self.contact: Contact | None = None
        """What the tissue did to the probe in the latest period; None without tissue."""
        self._push_B, self._push_periods = np.zeros(3), 0
        """Force of somebody's hand on the tip [N], and for how long yet."""
        self._held, self._held_at = 0, 0.0
        self._held_periods = 0
        """Joint that something holds fast, where [rad], and for how long yet."""
        self._exerted: Float[np.ndarray, 6] | None = None
        """Torque of the drives in this period, where they do not hold a position [N m]."""
        self._after_period: Callable[[], None] = lambda: None
        self._target = np.array(q, float)
        """The latest joint target [rad]."""
        self._servo = ServoJ(scene.config.servo, q)
        self._drives = Drives()
        self.calibration = scene.calibration
        """The arm's kinematics as the robot tells them; the simulated arm's own may be others."""
        self._elsewhere: mujoco.MjData | None = None
        self._diverged: RobotError | None = None
        self._breath_periods = 0
        """Since the breath began."""
        self._data.qpos[self._joints] = q
        self._advance()

    def _look_up(self) -> None:
        """Find in MuJoCo's arrays what is read and written every period; the views stay valid."""
        model, data = self._model, self._data
        first = model.joint(joint_names()[0])  # the others follow: they are one chain
        self._joints = slice(first.qposadr[0], first.qposadr[0] + len(joint_names()))
        self._dofs = slice(first.dofadr[0], first.dofadr[0] + len(joint_names()))
        self._wanted_acceleration, self._torque = np.zeros(model.nv), np.zeros(model.nv)
        tool, tip = data.body("tool"), data.site("tip")
        self._tool_id, self._tip_id = tool.id, tip.id
        self._tool_centre, self._applied = tool.xipos, tool.xfrc_applied
        self._p_BP, self._R_BP = tip.xpos, tip.xmat.reshape(3, 3)
        flange = data.body("flange")
        self._p_BF, self._R_BF = flange.xpos, flange.xmat.reshape(3, 3)

    @property
    def servo(self) -> Servo:
        """How the arm follows the targets of `servo_joint`, by its present settings."""
        return self._servo.config.servo

    def state(self) -> RobotState:
        """The latest sample."""
        return self._sample

    def watch(self, after_period: Callable[[], None]) -> None:
        """Call `after_period` at the end of every period; no simulated time passes while it
        runs.
        """
        self._after_period = after_period

    def limit_truth(self, periods: int) -> None:
        """Keep the truth of the latest so many periods, for a robot that runs for hours."""
        self._truth.limit(periods)

    def truth_log(self) -> TruthLog:
        """What really happened so far, one row a period."""
        return self._truth.log()

    def go_on(self, truth: TruthLog) -> None:
        """Begin with the truth of an earlier run; the clock goes on after it."""
        self._truth = TruthRecorder()
        self._truth.recall(truth)
        self._data.time = truth.time[-1] + PERIOD
        self._advance()

    def servo_joint(self, q: Float[np.ndarray, "6"]) -> None:
        """Track `q` [rad] for one period, as the controller's servoj does.

        Raises:
            RobotError: The target is not finite, outside the joint limits, or too far from the
                previous one.
        """
        targets.check_angles(q)
        targets.check_step(q, self._target, PERIOD)
        self.follow(q)

    def move_joint(self, q: Float[np.ndarray, "6"], speed: float, acceleration: float) -> None:
        """Move to `q` [rad] on a straight line in joint space and wait until there.

        Raises:
            RobotError: The target is out of reach, speed or acceleration are not positive, or the
                arm does not arrive.
        """
        targets.check_angles(q)
        targets.check_motion(speed, acceleration)
        self._brake()
        for target in trapezoid(self._servo.q_end, q, speed, acceleration, PERIOD):
            self.go(target)
        self._settle()

    def tare(self) -> None:
        """Hold still for `TARE_TIME` and take the mean wrench as zero."""
        wrenches = []
        for _ in range(round(TARE_TIME / PERIOD)):
            self.follow(self._target)
            wrenches.append(self._sample.wrench_P)
        zero_P = np.mean(wrenches, axis=0)
        self._sensor.tare(zero_P)
        self._sample = replace(self._sample, wrench_P=self._sample.wrench_P - zero_P)

    def zero_wrench(self) -> None:
        """Take the latest sample's wrench as zero, noise and all, as the controller's own
        function does.
        """
        self._sensor.tare(self._sample.wrench_P)
        self._sample = replace(self._sample, wrench_P=np.zeros(6))

    def restart(self) -> None:
        """Let noise, drift and breath begin anew: what follows is the same, whenever that is."""
        self._breath_periods = 0
        wrench_P = self._sensor.restart()
        self._sample = replace(self._sample, wrench_P=wrench_P, sample=self._sensor.samples)

    def drive_torques(self) -> Float[np.ndarray, "6"]:
        """What the drives do to the joints, without what holds the arm's weight [N m]."""
        return self._data.qfrc_actuator[self._dofs].copy()

    def external_torques(self) -> Float[np.ndarray, "6"]:
        """What acts on the joints from outside in the latest period, dry friction included: what
        moves the arm, less what the drives do and what it knows of itself [N m].
        """
        data, torque = self._data, np.zeros(self._model.nv)
        mujoco.mj_mulM(self._model, data, torque, data.qacc)
        torque += data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator
        return torque[self._dofs]

    def mass_matrix(
        self, q: Float[np.ndarray, "6"] | None = None, *, rotors: bool = True
    ) -> Float[np.ndarray, "6 6"]:
        """Of the arm with its tool at joint angles [rad], as it stands if None [kg m^2].

        `rotors`: whether rotors and gears count.
        """
        data = self._data if q is None else self._still(q, np.zeros(6))
        full = np.empty((self._model.nv, self._model.nv))
        mujoco.mj_fullM(self._model, data, full)
        mass = full[self._dofs, self._dofs]
        return mass if rotors else mass - np.diag(self._model.dof_armature[self._dofs])

    def velocity_torques(
        self, q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"]
    ) -> Float[np.ndarray, "6"]:
        """Coriolis and centrifugal torques at joint angles [rad] and speeds [rad/s] [N m]."""
        moving = self._still(q, qd).qfrc_bias[self._dofs].copy()
        return moving - self._still(q, np.zeros(6)).qfrc_bias[self._dofs]

    def _still(self, q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"]) -> mujoco.MjData:
        """The model's quantities in a state that the arm is not in; no time passes."""
        if self._elsewhere is None:
            self._elsewhere = mujoco.MjData(self._model)
        data: mujoco.MjData = self._elsewhere
        data.qpos[self._joints], data.qvel[self._dofs] = q, qd
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_fwdVelocity(self._model, data)
        return data

    def reading_F(self) -> Float[np.ndarray, "6"]:
        """The wrist sensor's last reading, the tool's weight and all, force first, at its
        measuring point [N, N m].
        """
        return self._sensor.reading_F

    def set_payload(self, payload: Payload) -> None:
        """Tell the robot what hangs on its wrist sensor. It starts with the tool's own numbers."""
        self._told_payload = payload
        self._sensor.set_payload(payload)

    @property
    def commanded(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """The commanded state as the latest period ends: joint angles [rad] and speeds [rad/s]."""
        return self._servo.commanded

    def programmed(self) -> ServoJ:
        """The commanded state by itself: what goes on from it moves no arm."""
        return copy.deepcopy(self._servo)

    @property
    def servo_config(self) -> ServoConfig:
        """How servoj follows at present."""
        return self._servo.config

    @property
    def commanded_acceleration(self) -> Float[np.ndarray, "6"]:
        """Commanded acceleration of the joints [rad/s^2]."""
        return self._servo.qdd

    def tune_servo(self, lookahead_time: float, gain: float) -> None:
        """Give servoj these settings from the next period on: [s], [1/s^2]."""
        self._servo.config = replace(self._servo.config, lookahead_time=lookahead_time, gain=gain)

    def stop(self) -> None:
        """Brake along the commanded motion and stay there."""
        self._brake()
        self._settle()

    def snapshot(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 3"] | None, float]:
        """Joint angles [rad], deformed skin in S [m] (None without tissue) and time [s], as a
        camera would see them.
        """
        skin_S = None if self._tissue is None else self._tissue.deformed_skin()
        return self._sample.q, skin_S, self._sample.time

    def _brake(self) -> None:
        for q in braking(self._servo.q_end, self._servo.qd, STOP_DECELERATION, PERIOD):
            self.go(q)

    def _settle(self) -> None:
        """Hold the joints' place until they are there."""
        error = np.inf
        for _ in range(round(SETTLE_TIME / PERIOD)):
            self.go(self._servo.q_end)
            error = np.abs(self._sample.q - self._servo.q).max()
            if error < ARRIVED:
                return
        raise RobotError(
            f"the arm does not arrive: {error:.4f} rad off after {SETTLE_TIME} s, something holds "
            "it",
            error,
        )

    def follow(self, target: Float[np.ndarray, "6"]) -> None:
        """One period of servoj towards `target` [rad], unchecked."""
        self._target = target.copy()
        self._servo.follow(target)
        self._advance()

    def go(self, q: Float[np.ndarray, "6"]) -> None:
        """One period of a motion of the controller's own, to `q` [rad], unchecked."""
        self._target = q.copy()
        self._servo.go(q)
        self._advance()

    def resync(self) -> None:
        """Take for commanded where the joints are, at rest: what the drives press lets go."""
        self._drives.release()
        self._servo.place(self._data.qpos[self._joints].copy(), np.zeros(6))

    def exert(self, torque: Float[np.ndarray, "6"]) -> None:
        """One period in which the drives hold no position: they give the joints this torque [N m],
        beside what the weight of the arm and of the payload it was told takes.
        """
        self._exerted = torque
        self._advance()
        self._exerted = None
        self._drives.release()
        self._servo.place(self._data.qpos[self._joints].copy(), self._data.qvel[self._dofs].copy())
        self._target = self._servo.q_end

    def push(self, force_B: Float[np.ndarray, "3"], seconds: float) -> None:
        """Push the tip with a force in B [N] for so long, whatever the arm does."""
        self._push_B, self._push_periods = force_B, round(seconds / PERIOD) + 1

    def hold(self, joint: int, seconds: float) -> None:
        """Hold a joint, 0 to 5, where it is for so long [s], more stiffly than its drive does."""
        self._held, self._held_at = joint, float(self._sample.q[joint])
        self._held_periods = round(seconds / PERIOD) + 1

    def _advance(self) -> None:
        """One period: sense, press, log, integrate."""
        if self._diverged is not None:
            raise self._diverged
        data = self._data
        mujoco.mj_step1(self._model, data)
        time = data.time
        q = data.qpos[self._joints].copy()
        qd = data.qvel[self._dofs].copy()
        self._wanted_acceleration[self._dofs] = self._servo.qdd
        mujoco.mj_mulM(self._model, data, self._torque, self._wanted_acceleration)
        inertia_torque = self._torque[self._dofs]
        if self._exerted is None:
            position, velocity = self._drives.commands(self._servo, q, inertia_torque)
        else:
            position = q + (self._exerted + self._excess_lift()) / STIFFNESS
            velocity = qd
        data.ctrl[0::2], data.ctrl[1::2] = position, velocity  # the actuators alternate
        X_SP = self._press(time, q)
        if self._push_periods:
            self._lean()
        if self._held_periods:
            self._clamp(q, qd)
        mujoco.mj_step2(self._model, data)
        if data.ncon:
            self._truth.add_rigid(rigid_contact(self._model, data, time, self._X_SB[:3, :3]))
        load_F = -data.sensordata[:6]  # MuJoCo gives what the sensor does to the tool
        wrench_P = self._sensor.measure(load_F, self._R_BF, *self._tool_motion())
        self._sample = RobotState(
            time=time, q=q, qd=qd, wrench_P=wrench_P, sample=self._sensor.samples
        )
        if divergence.has_diverged(data):
            self._diverged = divergence.report(data, q, qd, X_SP)
            raise self._diverged
        self._breath_periods += 1
        self._after_period()

    def _excess_lift(self) -> Float[np.ndarray, "6"]:
        """What lifting the payload it was told takes, over what its tool takes [N m]."""
        excess = np.zeros(6)
        for load, sign in ((self._told_payload, 1.0), (self._tool, -1.0)):
            centre_B = self._p_BF + self._R_BF @ load.centre_F
            jacobian = np.empty((3, self._model.nv))
            mujoco.mj_jac(self._model, self._data, jacobian, None, centre_B, self._tool_id)
            excess -= sign * load.mass * GRAVITY_W @ jacobian[:, self._dofs]
        return excess

    def _lean(self) -> None:
        """A period of somebody's push; in the end their hand is gone."""
        self._push_periods -= 1
        if self._tissue is None:
            self._applied[:] = 0.0
        force_B = self._push_B if self._push_periods else NOTHING
        self._applied[:3] += force_B
        self._applied[3:] += np.cross(self._p_BP - self._tool_centre, force_B)

    def _clamp(self, q: Float[np.ndarray, "6"], qd: Float[np.ndarray, "6"]) -> None:
        """A period of a joint's being held; in the end it is free."""
        self._held_periods -= 1
        i, held = self._held, self._held_periods > 0
        pull = 2 * JOINTS[i].stiffness * (self._held_at - q[i]) - JOINTS[i].damping * qd[i]
        self._data.qfrc_applied[self._dofs.start + i] = pull if held else 0.0

    def _tool_motion(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Velocity [m/s] and acceleration [m/s^2] of the tool's centre of mass in the world."""
        velocity, acceleration = np.empty(6), np.empty(6)
        mujoco.mj_objectVelocity(self._model, self._data, BODY, self._tool_id, velocity, 0)
        mujoco.mj_objectAcceleration(self._model, self._data, BODY, self._tool_id, acceleration, 0)
        # MuJoCo's acceleration is that against free fall
        return velocity[3:], acceleration[3:] + GRAVITY_W

    def _press(self, time: float, q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
        """Let the tissue push the probe where it is now, at `X_SP`, and write the truth down."""
        R_SB = self._X_SB[:3, :3]
        X_SP = self._X_SB.copy()
        X_SP[:3, :3] = R_SB @ self._R_BP
        breath_time = self._breath_periods * PERIOD
        lift = rise(self._breathing, breath_time)
        X_SP[:3, 3] += R_SB @ self._p_BP
        X_SP[2, 3] -= lift
        self._data.mocap_pos[0] = self._X_BS[:3, 3] + lift * self._X_BS[:3, 2]
        if self._tissue is None:
            self._truth.add(time, q, NOTHING, 0.0, X_SP, lift)
            return X_SP
        velocity_S = R_SB @ self._tip_velocity()
        velocity_S[2] -= rising_speed(self._breathing, breath_time)
        contact = self.contact = self._tissue.press(X_SP, velocity_S)
        force_B = contact.force_S @ R_SB
        lever_B = self._p_BP - self._tool_centre
        moment_B = np.empty(3)
        mujoco.mju_cross(moment_B, lever_B, force_B)
        self._applied[:3] = force_B
        self._applied[3:] = contact.torque_S @ R_SB + moment_B
        self._truth.add(time, q, contact.force_S, contact.depth, X_SP, lift)
        return X_SP

    def _tip_velocity(self) -> Float[np.ndarray, "3"]:
        """Velocity of the tip in B [m/s]."""
        spatial = np.empty(6)
        mujoco.mj_objectVelocity(self._model, self._data, SITE, self._tip_id, spatial, 0)
        return spatial[3:]
