"""The phases of a scan on a perfect arm over an elastic plane, where every force is known in closed form."""

import signal

import numpy as np
import pytest

from breastscan import execution, record
from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import RobotError, SafetyError
from breastscan.execution import ScanMotion
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from tests.springs import X_FP, SpringRobot

DOWN = np.diag([1.0, -1.0, -1.0])
SKIN = 0.10
"""Height of the planned skin in B [m]."""


def joints_at(x, z):
    """The elbow-up solution with the probe tip at (x, .13, z), pointing down."""
    X_BF = se3.pose(DOWN, np.array([x, 0.13, z])) @ se3.inverse(X_FP)
    solutions = kinematics.inverse(X_BF)
    return min(solutions, key=lambda q: np.abs(q - np.array([0.0, -1.6, 1.8, -1.8, -1.57, 0.0])).sum())


@pytest.fixture(scope="module")
def motion():
    """A straight sweep of 50 mm at 25 mm/s over the plane."""
    start = joints_at(0.45, SKIN)
    s = np.arange(0.0, 0.05, 0.025 * 0.002)
    q = [start]
    for step in s[1:]:
        X_BF = se3.pose(DOWN, np.array([0.45 + step, 0.13, SKIN])) @ se3.inverse(X_FP)
        q.append(min(kinematics.inverse(X_BF), key=lambda c: np.abs(c - q[-1]).sum()))
    q = np.array(q)
    qd = np.gradient(q, 0.002, axis=0)
    clear = joints_at(0.45, SKIN + 0.03)
    return ScanMotion(q=q, qd=qd, s=s, q_approach=clear, clearance=0.03, q_home=clear)


def scan(motion, height=SKIN, stiffness=1000.0, **settings):
    robot = SpringRobot(motion.q_home, height, stiffness)
    log = execution.execute(robot, motion, ContactConfig(**settings), SafetyLimits())
    return robot, record.trajectory(log, motion, robot.X_FP, robot.calibration)


def test_the_loop_holds_five_newtons_within_a_tenth(motion):
    _, table = scan(motion)
    force = -table.filter(table["phase"] == "loop")["wrench"].to_numpy()[:, 2]
    assert np.abs(force - 5.0).max() < 0.1


def test_phases_come_in_order_and_the_probe_leaves_the_skin(motion):
    robot, table = scan(motion)
    phases = table["phase"].to_list()
    assert list(dict.fromkeys(phases)) == ["approach", "settle", "loop", "retreat"]
    heights = table["X_BP"].to_numpy().reshape(-1, 4, 4)[:, 2, 3]
    assert SKIN + 0.03 <= heights[-1] < SKIN + 0.0315  # it brakes beyond the clearance
    assert abs(heights[-1] - heights[-2]) < 3e-6
    assert not robot.stopped


def test_the_tip_never_accelerates_along_its_axis_faster_than_configured(motion):
    _, table = scan(motion)
    depth = SKIN - table["X_BP"].to_numpy().reshape(-1, 4, 4)[:, 2, 3]
    assert np.abs(np.diff(depth, 2)).max() / SpringRobot.period**2 < ContactConfig().acceleration * 1.01


def test_tangential_tracking_is_exact_with_a_perfect_servo(motion):
    _, table = scan(motion)
    loop = table.filter(table["phase"] == "loop")
    executed = loop["X_BP"].to_numpy().reshape(-1, 4, 4)
    planned = loop["X_BP_plan"].to_numpy().reshape(-1, 4, 4)
    assert np.abs(executed[:, :2, 3] - planned[:, :2, 3]).max() < 1e-6
    # 5 N on 1 kN/m: the normal part is the indentation
    np.testing.assert_allclose(planned[:, 2, 3] - executed[:, 2, 3], 0.005, atol=1e-4)


def test_a_late_arm_is_where_the_plan_is_because_the_plan_is_sent_ahead(motion):
    robot = SpringRobot(motion.q_home, SKIN, late=17)
    log = execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    table = record.trajectory(log, motion, robot.X_FP, robot.calibration)
    loop = table.filter(table["phase"] == "loop")
    executed, planned = (loop[name].to_numpy().reshape(-1, 4, 4)[:, :2, 3] for name in ("X_BP", "X_BP_plan"))
    assert len(loop) == len(motion.q)
    assert np.abs(executed - planned).max() < 1e-6
    assert np.abs(-loop["wrench"].to_numpy()[:, 2] - 5.0).max() < 0.1


def test_skin_eight_millimetres_from_where_it_was_planned_is_found(motion):
    for height in (SKIN - 0.008, SKIN + 0.008):
        _, table = scan(motion, height=height)
        force = -table.filter(table["phase"] == "loop")["wrench"].to_numpy()[:, 2]
        assert np.abs(force - 5.0).max() < 0.1


def test_no_skin_ends_in_an_error_and_a_retreat(motion):
    robot = SpringRobot(motion.q_home, SKIN - 0.5)
    with pytest.raises(RobotError, match="no contact within 15 mm"):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    tip = kinematics.forward(robot.q) @ X_FP
    assert tip[2, 3] > SKIN + 0.028
    assert robot.stopped


def test_a_force_beyond_the_limit_ends_in_an_error_and_a_retreat(motion):
    robot = SpringRobot(motion.q_home, SKIN, stiffness=1000.0)
    steps = 0
    send = robot.servo_joint

    def hardening(q):
        nonlocal steps
        steps += 1
        robot.stiffness = 1000.0 if steps < 3500 else 6000.0
        send(q)

    robot.servo_joint = hardening
    with pytest.raises(SafetyError, match="contact force"):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    tip = kinematics.forward(robot.q) @ X_FP
    assert tip[2, 3] > SKIN + 0.028
    assert robot.stopped


def test_ctrl_c_in_contact_retreats_before_it_ends_the_program(motion):
    robot = SpringRobot(motion.q_home, SKIN)

    def interrupt(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits(), progress=interrupt)
    assert (kinematics.forward(robot.q) @ X_FP)[2, 3] > SKIN + 0.028
    assert robot.stopped


def test_a_real_ctrl_c_waits_for_the_end_of_a_command_and_a_second_one_does_not_end_the_retreat(motion):
    robot = SpringRobot(motion.q_home, SKIN)
    send, commands = robot.servo_joint, 0

    def interrupted_inside_the_command(q):
        nonlocal commands
        commands += 1
        if commands in (2800, 2850):
            signal.raise_signal(signal.SIGINT)
        send(q)

    robot.servo_joint = interrupted_inside_the_command
    with pytest.raises(KeyboardInterrupt):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    assert commands > 2850
    assert (kinematics.forward(robot.q) @ X_FP)[2, 3] > SKIN + 0.028
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("deviation", [0.0, 1e-3])
def test_a_newton_step_puts_the_shifted_tip_where_it_belongs_on_whatever_arm(motion, deviation):
    arm = KinematicCalibration.from_dh_corrections(**dict.fromkeys(("theta", "d", "a", "alpha"), np.full(6, deviation)))
    q, depth = motion.q[100], 0.0001
    X_goal = arm.forward(q) @ X_FP
    X_goal[:3, 3] += depth * X_goal[:3, 2]
    X_reached = arm.forward(execution.shifted_joints(arm, q, q, X_FP, depth)) @ X_FP
    np.testing.assert_allclose(X_reached, X_goal, atol=1e-7)
