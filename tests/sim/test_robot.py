from pathlib import Path

import numpy as np
import pytest

from breastscan.control.contact import ContactConfig
from breastscan.control.phases import Phase
from breastscan.control.safety import SafetyLimits
from breastscan.errors import RobotError
from breastscan.execution import execute
from breastscan.geometry import kinematics, se3
from breastscan.robot.payload import Payload, identify
from breastscan.robot.ur.ur5e import PERIOD, SPEED_LIMIT
from sim.arm.deviations import ArmConfig
from sim.arm.servo import ServoConfig
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.tissue.soft import SoftTissue
from sim.true_loop import true_loop_motion
from sim.wrist.probe import payload
from sim.wrist.wrench_errors import WrenchSensorConfig
from sim.wrist.wrench_sensor import MEASURED_AT_F
from tests.sim.tissue.closed_form_tissue import ExplodingTissue, SpringTissue, UndefinedTissue
from tests.sim.tissue.press_poses import loop_pose

STIFFNESS = 800.0
"""Stiffness of the test's spring [N/m]."""


def straight_down(scene, q, depth, speed):
    """Joint targets that lower the tip by `depth` [m] along z of B at `speed` [m/s]."""
    X_BP = kinematics.forward(q) @ scene.X_FP
    targets = []
    for way in np.arange(0, depth, speed * PERIOD):
        X = X_BP.copy()
        X[2, 3] -= way
        q = nearest(kinematics.inverse(X @ se3.inverse(scene.X_FP)), q)
        targets.append(q)
    return targets


def nearest(solutions, q):
    unwound = q + (solutions - q + np.pi) % (2 * np.pi) - np.pi
    return unwound[np.abs(unwound - q).max(axis=1).argmin()]


def test_rests_at_home_with_no_wrench(quiet_scene):
    state = SimRobot(quiet_scene).state()
    np.testing.assert_allclose(state.q, HOME_Q, atol=1e-9)
    np.testing.assert_allclose(state.wrench_P, 0, atol=1e-6)


def test_follows_a_25_mm_per_s_circle_within_a_tenth_of_a_millimetre_one_servo_lag_late(
    quiet_scene,
):
    robot = SimRobot(quiet_scene)
    X_BP = kinematics.forward(HOME_Q) @ quiet_scene.X_FP
    radius = 0.06
    speed = 0.025
    q = HOME_Q
    planned_B = []
    for k in range(int(3.0 / PERIOD)):
        time = k * PERIOD
        angle = speed / radius * (time - 1 + np.exp(-time))
        X = X_BP.copy()
        X[:3, 3] += radius * np.array([np.cos(angle) - 1, np.sin(angle), 0])
        q = nearest(kinematics.inverse(X @ se3.inverse(quiet_scene.X_FP)), q)
        planned_B.append(X[:3, 3])
        robot.servo_joint(q)
    tips_B = se3.transform(quiet_scene.X_BS, robot.truth_log().X_SP[1:, :3, 3])
    late = round(robot.servo.lag / PERIOD)
    errors = np.linalg.norm(tips_B[late:] - np.array(planned_B[:-late]), axis=1)
    assert errors.max() < 0.1e-3
    trailing = np.linalg.norm(tips_B[-1] - planned_B[-1])
    assert trailing == pytest.approx(speed * robot.servo.lag, abs=0.1e-3)


def test_a_pressing_probe_feels_the_tissue_as_a_negative_force_along_its_axis(quiet_scene):
    """Statics: the wrist reads what the spring gives, whatever posture the arm is in."""
    tip_S = quiet_scene.X_BS[:3, 3] - (kinematics.forward(HOME_Q) @ quiet_scene.X_FP)[:3, 3]
    tissue = SpringTissue(height=-tip_S[2] - 0.005, stiffness=STIFFNESS)
    robot = SimRobot(quiet_scene, tissue)
    robot.tare()
    np.testing.assert_allclose(robot.state().wrench_P, 0, atol=1e-4)
    targets = straight_down(quiet_scene, HOME_Q, depth=0.010, speed=0.02)
    for q in targets + [targets[-1]] * 300:
        robot.servo_joint(q)
    truth, state = robot.truth_log(), robot.state()
    X_SP = truth.X_SP[-1]
    assert truth.depth[-1] == pytest.approx(0.005, abs=0.3e-3)
    np.testing.assert_allclose(truth.force_S[-1], [0, 0, STIFFNESS * truth.depth[-1]])
    assert truth.force_axial[-1] == pytest.approx(-truth.force_S[-1] @ X_SP[:3, 2])
    np.testing.assert_allclose(state.wrench_P[:3], X_SP[:3, :3].T @ truth.force_S[-1], atol=0.01)
    np.testing.assert_allclose(state.wrench_P[3:], 0, atol=0.002)
    assert state.wrench_P[2] < 0


def test_a_lasting_load_does_not_shift_the_arm(quiet_scene):
    """The drive's integral: 4 N at the tip would bend the proportional part alone by a tenth of
    a millimetre.
    """
    tip_S = quiet_scene.X_BS[:3, 3] - (kinematics.forward(HOME_Q) @ quiet_scene.X_FP)[:3, 3]
    robot = SimRobot(quiet_scene, SpringTissue(height=-tip_S[2] + 0.005, stiffness=STIFFNESS))
    for _ in range(500):
        robot.servo_joint(HOME_Q)
    assert robot.truth_log().force_S[-1, 2] == pytest.approx(4.0, abs=0.05)
    tip_B = kinematics.forward(robot.state().q) @ quiet_scene.X_FP
    assert np.abs(tip_B[:3, 3] + tip_S - quiet_scene.X_BS[:3, 3]).max() < 0.01e-3


def test_an_arm_that_deviates_reports_by_its_calibration_while_the_truth_goes_by_its_own_axes():
    scene = Scene(SceneConfig(arm=ArmConfig(kinematics="calibrated", seed=2)))
    robot = SimRobot(scene)
    reported_B = robot.calibration.forward(robot.state().q) @ robot.X_FP
    true_B = scene.X_BS @ robot.truth_log().X_SP[-1]
    np.testing.assert_allclose(true_B, scene.arm.forward(robot.state().q) @ robot.X_FP, atol=1e-9)
    assert 0.01e-3 < np.linalg.norm((reported_B - true_B)[:3, 3]) < 1e-3


@pytest.mark.parametrize("quality", ["ideal", "industrial"])
def test_an_arm_that_shakes_its_tool_in_the_air_feels_little_of_it(quality):
    """2 m/s^2 on .39 kg would read .8 N as contact; what is left stays within the sensor's own
    noise.
    """
    robot = SimRobot(Scene(SceneConfig(wrist=WrenchSensorConfig(quality=quality))))
    robot.tare()
    times = PERIOD * np.arange(600)
    read = []
    truth = []
    for t in times:
        robot.servo_joint(
            HOME_Q + 0.009 * np.sin(2 * np.pi * 3.0 * t) * np.array([1, 1, 1, 0, 0, 0])
        )
        read.append(robot.state().wrench_P[:3])
        truth.append(
            se3.transform(robot.calibration.forward(robot.state().q) @ robot.X_FP, np.zeros(3))
        )
    shaken = np.diff(truth, 2, axis=0) / PERIOD**2
    assert np.linalg.norm(shaken[200:], axis=1).max() > 1.5
    left = np.linalg.norm(np.array(read)[200:], axis=1)
    assert left.max() < (1e-6 if quality == "ideal" else 5 * 0.05)


def test_the_payload_is_identified_by_the_poses_of_the_arm_to_grams_and_millimetres():
    """As on the robot: six poses at rest, .12 s each, with a sensor that was told nothing of the
    tool.
    """
    scene = Scene(SceneConfig(wrist=WrenchSensorConfig(gain_error=0.0, cross_talk=0.0)))
    robot, true = SimRobot(scene), payload(scene.config.mount_angle)
    robot.set_payload(Payload(mass=0.0, centre_F=np.zeros(3)))
    readings_F, R_BF = [], []
    for turn in np.radians(
        [[0, 0, 0], [-50, 0, 0], [50, 0, 0], [0, 50, 0], [0, -50, 0], [40, 40, 60]]
    ):
        robot.move_joint(HOME_Q + np.array([0, 0, 0, *turn]), 3.0, 10.0)
        block = []
        for _ in range(60):
            robot.servo_joint(robot.state().q)
            block.append(robot.reading_F())
        readings_F.append(np.mean(block, axis=0))
        R_BF.append(robot.calibration.forward(robot.state().q)[:3, :3])
    found = identify(np.array(readings_F), np.array(R_BF), MEASURED_AT_F)
    assert found.payload.mass == pytest.approx(true.mass, abs=0.003)
    np.testing.assert_allclose(found.payload.centre_F, true.centre_F, atol=0.003)
    assert found.force_rms < 0.05


def test_sample_and_truth_belong_to_the_same_instant(quiet_scene):
    robot = SimRobot(quiet_scene)
    robot.move_joint(HOME_Q + 0.05, 0.5, 2.0)
    state, truth = robot.state(), robot.truth_log()
    assert state.time == truth.time[-1]
    np.testing.assert_array_equal(state.q, truth.q[-1])
    X_BP = quiet_scene.X_BS @ truth.X_SP[-1]
    np.testing.assert_allclose(X_BP, kinematics.forward(state.q) @ quiet_scene.X_FP, atol=1e-9)


def test_move_joint_arrives_and_keeps_its_limits(quiet_scene):
    robot = SimRobot(quiet_scene)
    goal = HOME_Q + np.array([0.4, -0.2, 0.1, 0.3, -0.4, 0.5])
    robot.move_joint(goal, 0.8, 1.5)
    truth = robot.truth_log()
    speed = np.abs(np.diff(truth.q, axis=0)).max() / PERIOD
    assert np.abs(robot.state().q - goal).max() < 2e-4
    assert speed == pytest.approx(0.8, rel=0.1)
    assert truth.time[-1] == pytest.approx(0.5 / 0.8 + 0.8 / 1.5, abs=0.1)


def test_every_sample_of_the_wrist_sensor_is_counted(quiet_scene):
    robot = SimRobot(quiet_scene)
    first = robot.state().sample
    for k in range(1, 6):
        robot.servo_joint(HOME_Q)
        assert robot.state().sample == first + k


def test_a_motion_of_its_own_brakes_what_the_servo_left_moving(quiet_scene):
    """From .5 rad/s the controller brakes at 4 rad/s^2 before it turns back: no joint is asked
    to jump.
    """
    robot = SimRobot(quiet_scene)
    for k in range(100):
        robot.servo_joint(HOME_Q + 0.5 * k * PERIOD)
    robot.move_joint(HOME_Q, 0.5, 2.0)
    speed = np.diff(robot.truth_log().q, axis=0) / PERIOD
    assert np.abs(np.diff(speed[110:], axis=0)).max() / PERIOD < 20.0
    assert np.abs(robot.state().q - HOME_Q).max() < 2e-4


def test_stop_brakes_gently_and_stays(quiet_scene):
    robot = SimRobot(quiet_scene)
    for k in range(100):
        robot.servo_joint(HOME_Q + 0.5 * k * PERIOD)
    robot.stop()
    for _ in range(100):
        robot.servo_joint(robot.state().q)
    late = robot.truth_log().q[-50:]
    assert np.ptp(late, axis=0).max() < 5e-4
    assert np.abs(robot.state().qd).max() < 2e-3
    way = (robot.state().q - HOME_Q - 0.5 * 99 * PERIOD).max()
    assert 0 < way < 0.05


def test_two_runs_agree_to_the_last_bit():
    """The whole twin: an arm of its own, servoj, drives, the soft phantom and a sensor with
    every error.
    """
    scene = Scene(
        SceneConfig(
            arm=ArmConfig(kinematics="calibrated", seed=3),
            wrist=WrenchSensorConfig(quality="ur5e_builtin", seed=3),
        )
    )
    above = loop_pose(scene.phantom, 0.4, -0.003)
    q_above = nearest(kinematics.inverse(scene.X_BS @ above @ se3.inverse(scene.X_FP)), HOME_Q)
    runs = []
    for _ in range(2):
        robot = SimRobot(scene, SoftTissue.build(scene.phantom), q_above)
        robot.tare()
        for depth in np.linspace(0.0, 0.008, 100):
            X_BF = (
                scene.X_BS @ loop_pose(scene.phantom, 0.4, depth - 0.003) @ se3.inverse(scene.X_FP)
            )
            robot.servo_joint(nearest(kinematics.inverse(X_BF), q_above))
        robot.move_joint(q_above, 0.5, 1.0)
        runs.append((robot.state(), robot.truth_log()))
    (state, truth), (other_state, other_truth) = runs
    assert truth.force_axial.max() > 1.0
    for name, values in vars(truth).items():
        np.testing.assert_array_equal(values, getattr(other_truth, name))
    for name, value in vars(state).items():
        np.testing.assert_array_equal(value, getattr(other_state, name))


@pytest.mark.parametrize(
    ("offset", "why"), [(np.nan, "finite"), (np.inf, "finite"), (10.0, "within"), (0.5, "jumps")]
)
def test_targets_that_no_arm_can_follow_are_refused(quiet_scene, offset, why):
    robot = SimRobot(quiet_scene)
    with pytest.raises(RobotError, match=why):
        robot.servo_joint(HOME_Q + offset)
    robot.servo_joint(HOME_Q)


@pytest.mark.parametrize(
    ("speed", "acceleration"), [(0.0, 1.0), (-1.0, 1.0), (2 * SPEED_LIMIT, 1.0), (1.0, 0.0)]
)
def test_motions_that_no_arm_can_make_are_refused(quiet_scene, speed, acceleration):
    with pytest.raises(RobotError, match="move_joint"):
        SimRobot(quiet_scene).move_joint(HOME_Q, float(speed), acceleration)


def test_a_contact_force_that_is_no_number_ends_the_simulation_with_time_cause_and_state(
    quiet_scene,
):
    with pytest.raises(
        RobotError, match=r"diverged at 0\.000 s: the tissue's contact force is not a number"
    ) as caught:
        SimRobot(quiet_scene, UndefinedTissue())
    with np.load(caught.value.value) as state:
        np.testing.assert_array_equal(state["q"], HOME_Q)
        assert np.isnan(state["applied"]).any()
    Path(caught.value.value).unlink()


def test_a_tissue_too_stiff_for_the_time_step_is_named_and_the_arm_stays_stopped(quiet_scene):
    tip_S = quiet_scene.X_BS[:3, 3] - (kinematics.forward(HOME_Q) @ quiet_scene.X_FP)[:3, 3]
    robot = SimRobot(quiet_scene, ExplodingTissue(height=-tip_S[2] - 0.001))
    with pytest.raises(RobotError, match=r"diverged at \d\.\d\d\d s: ") as caught:
        for q in straight_down(quiet_scene, HOME_Q, depth=0.02, speed=0.02):
            robot.servo_joint(q)
    with np.load(caught.value.value) as state:
        assert np.isfinite(state["q"]).all()
        assert 0.0 < state["time"] < 1.0
    with pytest.raises(RobotError) as again:
        robot.servo_joint(q)
    assert again.value is caught.value
    Path(caught.value.value).unlink()


def test_what_the_probes_body_presses_is_in_the_truth_and_in_the_sensor(quiet_scene):
    """Beside the breast, straight down on the chest plate: statics, as with the tissue."""
    X_BP = quiet_scene.X_BS @ se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([-0.13, 0.0, 0.0]))
    q = nearest(kinematics.inverse(X_BP @ se3.inverse(quiet_scene.X_FP)), HOME_Q)
    robot = SimRobot(quiet_scene)
    robot.move_joint(q, 1.0, 3.0)
    robot.tare()
    before = robot.truth_log()
    assert not before.rigid_force.any()
    assert before.touched_else is None
    targets = straight_down(quiet_scene, q, depth=0.0105, speed=0.005)
    for target in targets + [targets[-1]] * 500:
        robot.servo_joint(target)
    truth, state = robot.truth_log(), robot.state()
    assert truth.chest_S[-1, 2] > 5.0
    chest_P = truth.X_SP[-1, :3, :3].T @ truth.chest_S[-1]
    np.testing.assert_allclose(state.wrench_P[:3], chest_P, atol=0.2)
    assert truth.force_any.max() == pytest.approx(np.linalg.norm(truth.chest_S, axis=1).max())
    touching = truth.of_arm != ""
    assert truth.X_SP[touching, 2, 3].max() == pytest.approx(-0.010, abs=0.1e-3)
    assert set(truth.of_arm[touching]) == {"probe_hull"}
    assert set(truth.of_other[touching]) == {"chest_hull"}
    assert "the probe's body touched the chest plate" in truth.touched_else


def test_an_arm_without_lag_holds_the_force_though_its_sensor_feels_the_tools_inertia():
    """What the law passes on of the sensor's noise would throw such an arm about."""
    scene = Scene(SceneConfig(servo=ServoConfig(lag=False)).seeded(0))
    tissue = SoftTissue.build(scene.phantom)
    robot = SimRobot(scene, tissue)
    log = []
    execute(robot, true_loop_motion(scene, tissue), ContactConfig(), SafetyLimits(), log=log)
    steady = np.array([sample.time for sample in log if sample.phase is Phase.LOOP][500:])
    truth = robot.truth_log()
    force = truth.force_axial[np.searchsorted(truth.time, steady)]
    assert len(force) > 5000
    assert np.sqrt(np.mean((force - 5.0) ** 2)) < 0.1
    assert force.max() < 5.5
