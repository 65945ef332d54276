"""A scan on a perfect arm over an elastic plane, where every force is known in closed form."""

import ast
import inspect
import math
import re
import signal
import textwrap
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.control.settle_fit import POWER
from breastscan.errors import PlanningError, RobotError, SafetyError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion, joined
from breastscan.run.trajectory import Sample
from breastscan.servo import Servo
from tests.springs import PERIOD, X_FP, SpringRobot

DOWN = np.diag([1.0, -1.0, -1.0])
SKIN = 0.10
"""Height of the planned skin in B [m]."""
CLEARANCE = 0.03
DOCS = Path(__file__).parent.parent / "docs"
SPEED, RAMP = 0.025, 0.5


def joints_at(x, z):
    """The elbow-up solution with the probe tip at (x, .13, z), pointing down."""
    X_BF = se3.pose(DOWN, np.array([x, 0.13, z])) @ se3.inverse(X_FP)
    solutions = kinematics.inverse(X_BF)
    return min(
        solutions, key=lambda q: np.abs(q - np.array([0.0, -1.6, 1.8, -1.8, -1.57, 0.0])).sum()
    )


@pytest.fixture(scope="module")
def motion():
    """A straight sweep of 37.5 mm over the plane, with speeds that ramp up and down."""
    ramp = np.arange(0.0, 1.0, PERIOD / RAMP)
    speed = SPEED * np.concatenate([ramp, np.ones(round(1.0 / PERIOD)), 1.0 - ramp, [0.0]])
    s = np.concatenate([[0.0], np.cumsum(speed) * PERIOD])
    q = [joints_at(0.45, SKIN)]
    for way in s[1:]:
        X_BF = se3.pose(DOWN, np.array([0.45 + way, 0.13, SKIN])) @ se3.inverse(X_FP)
        q.append(min(kinematics.inverse(X_BF), key=lambda c: np.abs(c - q[-1]).sum()))
    q, clear = np.array(q), joints_at(0.45, SKIN + CLEARANCE)
    qd = np.gradient(q, PERIOD, axis=0)
    return Motion(q=q, qd=qd, s=s, q_approach=clear, clearance=CLEARANCE)


DEFAULTS = ContactConfig()


def scan(motion, height=SKIN, stiffness=1000.0, late=0, config=DEFAULTS, **options):
    """The robot, its trajectory, and the error that ended the scan, if any."""
    robot = SpringRobot(motion.q_approach, height, stiffness, late)
    log = []
    error = None
    try:
        execution.execute(robot, motion, config, SafetyLimits(), log=log, **options)
    except (PlanningError, RobotError, SafetyError, KeyboardInterrupt) as caught:
        error = caught
    return robot, scan_log.trajectory(log, motion, robot), error


def phases_of(table):
    return [phase for k, phase in enumerate(table.phase) if k == 0 or table.phase[k - 1] != phase]


def heights_of(table, phase=None):
    return table.X_BP[..., 2, 3][[phase in (None, name) for name in table.phase]]


def loop_force(table):
    return table.pressing_force[table.in_loop]


def test_the_loop_holds_five_newtons_within_a_tenth(motion):
    _, table, _ = scan(motion)
    assert np.abs(loop_force(table) - 5.0).max() < 0.1


@dataclass(frozen=True)
class Proportional:
    """A force law of a user's own."""

    gain: float = 0.01
    """Speed per force error [m/s/N]."""

    def begin(self, force):
        return None

    def speed(self, measurement, reference, memory):
        return self.gain * (reference.force - measurement.force), memory


def test_a_law_of_ones_own_holds_five_newtons_within_a_tenth(motion):
    _, table, error = scan(motion, late=4, config=ContactConfig(law=Proportional()))
    assert error is None
    assert np.abs(loop_force(table) - 5.0).max() < 0.1


def test_the_law_of_the_documentation_holds_five_newtons(motion):
    """The example in docs/control.md, but for the call."""
    source = (DOCS / "control.md").read_text(encoding="utf-8")
    example = source.split("```python\n")[1].split("```")[0].split("execute(robot")[0]
    names: dict = {}
    exec(example, names)
    _, table, error = scan(motion, config=ContactConfig(law=names["Relative"]()))
    assert error is None
    assert np.abs(loop_force(table) - 5.0).max() < 0.1


def test_the_cycle_calls_the_steps_of_the_documented_table_in_order():
    source = (DOCS / "control.md").read_text(encoding="utf-8")
    table = source.split("| step |")[1].split("\n\n")[0]
    documented = re.findall(r"^\| (\w+) \|", table, flags=re.MULTILINE)
    cycle = ast.parse(textwrap.dedent(inspect.getsource(execution._Cycle.cycle)))
    called = [
        node.func.attr
        for node in ast.walk(cycle)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]
    assert called == documented


def test_phases_come_in_order_and_the_probe_leaves_the_skin(motion):
    robot, table, error = scan(motion)
    assert error is None
    assert phases_of(table) == ["approach", "settle", "loop", "lift", "retreat"]
    heights = heights_of(table)
    # it brakes beyond the clearance
    assert SKIN + CLEARANCE <= heights[-1] < SKIN + CLEARANCE + 0.0015
    assert abs(heights[-1] - heights[-2]) < 80e-6
    assert not robot.stopped


def test_the_tip_never_accelerates_along_its_axis_faster_than_configured(motion):
    _, table, _ = scan(motion)
    assert (
        np.abs(np.diff(heights_of(table), 2)).max() / PERIOD**2
        < ContactConfig().acceleration * 1.01
    )


@pytest.mark.parametrize("late", [0, 4])
def test_the_arm_is_where_the_plan_is_however_late_its_servo(motion, late):
    _, table, _ = scan(motion, late=late)
    executed, planned = (X[table.in_loop, :3, 3] for X in (table.X_BP, table.X_BP_plan))
    # while the feed override ramps, the lead is off by 1 ms
    assert np.abs(executed - planned)[:, :2].max() < 0.02e-3
    # 5 N on 1 kN/m: the normal part is the indentation
    np.testing.assert_allclose(planned[:, 2] - executed[:, 2], 0.005, atol=1e-4)


def test_skin_eight_millimetres_from_where_it_was_planned_is_found(motion):
    for height in (SKIN - 0.008, SKIN + 0.008):
        _, table, _ = scan(motion, height=height)
        assert np.abs(loop_force(table) - 5.0).max() < 0.1


@pytest.mark.parametrize(
    ("height", "error", "why"),
    [
        (SKIN - 0.5, RobotError, "no contact within 12 mm"),
        (SKIN + 0.015, SafetyError, "before where it was planned"),
    ],
)
def test_skin_outside_the_approachs_window_ends_in_a_retreat(motion, height, error, why):
    robot, table, raised = scan(motion, height=height)
    assert isinstance(raised, error)
    assert why in str(raised)
    assert phases_of(table) == ["approach", "emergency retreat"]
    assert heights_of(table)[-1] > SKIN + CLEARANCE - 1e-6
    assert robot.stopped
    assert robot.largest_force < 2.0


def test_a_pause_waits_clear_of_the_skin_and_goes_on_at_the_same_place(motion):
    asked = 0

    def pause():
        nonlocal asked
        asked += 1
        return 550 < asked < 1300

    _, table, error = scan(motion, pause=pause)
    assert error is None
    assert phases_of(table) == [
        "approach", "settle", "loop", "halt", "lift", "retreat",
        "pause", "approach", "settle", "loop", "lift", "retreat",
    ]  # fmt: skip
    assert (heights_of(table, "pause") >= SKIN + CLEARANCE).all()
    way = table.s[table.in_loop]
    assert way[-1] == pytest.approx(motion.s[-1], abs=1e-6)
    # between the loops lies what the feed needs to come to rest, in the phase "halt"
    assert 0.0 < np.diff(way).max() < 0.5 * SPEED * ContactConfig().phases.override_time * 1.1
    assert np.abs(loop_force(table) - 5.0).max() < 0.15


def test_a_scan_that_was_cut_off_starts_again_where_it_ended(motion):
    _, table, error = scan(motion, start=150)
    assert error is None
    assert table.s[table.in_loop][0] == pytest.approx(motion.s[150], abs=0.05e-3)
    assert (heights_of(table, "travel") >= SKIN + CLEARANCE - 1e-6).all()
    assert np.abs(loop_force(table) - 5.0).max() < 0.1


@pytest.mark.parametrize("left", ["in contact", "half-way up", "clear of the skin"])
@pytest.mark.parametrize("start", [0, 100, 150, 200])
def test_an_arm_that_was_left_on_the_path_goes_up_its_normal_and_contact_is_made_at_the_start(
    motion, left, start
):
    """Before row 150, there, or behind it; the sensor is tared in the air in front of the place."""
    depth = {"in contact": -0.005, "half-way up": 0.012, "clear of the skin": CLEARANCE}[left]
    q_left = joints_at(0.45 + motion.s[150], SKIN + depth)
    robot = SpringRobot(q_left, SKIN)
    moves, tared = [], []
    move, tare = robot.move_joint, robot.tare
    robot.move_joint = lambda q, *rest: (moves.append(q), move(q, *rest))
    robot.tare = lambda: (tared.append(kinematics.forward(robot.q) @ X_FP), tare())
    earlier = Sample(-1.0, "loop", 160.0, *np.zeros((3, 6)), np.zeros(6), True)
    log = [earlier]
    execution.execute(robot, motion, DEFAULTS, SafetyLimits(), log=log, start=start)
    table = scan_log.trajectory(log, motion, robot)

    first_place = kinematics.forward(moves[0]) @ X_FP
    if start > 0 or left == "in contact":
        assert first_place[0, 3] == pytest.approx(0.45 + motion.s[150], abs=0.002)
    assert all((kinematics.forward(q) @ X_FP)[2, 3] > SKIN + 0.9 * CLEARANCE for q in moves[:-1])
    assert tared[-1][0, 3] == pytest.approx(0.45 + motion.s[start], abs=1e-4)
    assert all(X[2, 3] > SKIN + 0.9 * CLEARANCE for X in tared)
    assert phases_of(table)[:2] == ["loop", "resume"]
    assert table.s[1] == motion.s[start]
    again = table.s[[phase in ("overlap", "loop") for phase in table.phase]][1:]
    assert again[0] == pytest.approx(motion.s[start], abs=0.1e-3)
    assert again[-1] == pytest.approx(motion.s[-1], abs=1e-6)
    assert np.diff(again).max() < 1.1 * SPEED * PERIOD
    assert robot.largest_force < 6.0
    if left == "in contact":
        assert (kinematics.forward(robot.q) @ X_FP)[2, 3] > SKIN + 0.9 * CLEARANCE  # parked


def test_the_arm_parks_where_it_stood_or_where_it_is_told(motion):
    robot, _, _ = scan(motion)
    np.testing.assert_array_equal(robot.q, motion.q_approach)
    above_end = motion.lifted(len(motion.q) - 1, X_FP, KinematicCalibration.nominal())
    robot, _, _ = scan(motion, q_home=above_end)
    np.testing.assert_array_equal(robot.q, above_end)


@pytest.mark.parametrize("detour", [False, True])
def test_strokes_are_done_one_after_the_other_each_with_a_tare_and_a_touch_of_its_own(
    motion, detour
):
    """To and fro over the same way; the arm goes around only where it has to."""
    back = replace(motion, q=motion.q[::-1].copy(), qd=-motion.qd[::-1])
    both = joined([motion, back])
    away = motion.q_approach + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    over = (away,) if detour else ()
    both = replace(both, ways=((), over, over))
    robot = SpringRobot(motion.q_approach, SKIN)
    tared, freely, log = [], [], []
    tare, move = robot.tare, robot.move_joint
    robot.tare = lambda: (tared.append(robot.q.copy()), tare())
    robot.move_joint = lambda q, *limits: (freely.append(np.array(q)), move(q, *limits))
    execution.execute(robot, both, ContactConfig(), SafetyLimits(), log=log)
    table = scan_log.trajectory(log, both, robot)
    one = ["approach", "settle", "loop", "lift", "retreat"]
    assert [phase for phase in phases_of(table) if phase != "travel"] == 2 * one
    assert len(tared) == 2
    heights = [(kinematics.forward(q) @ X_FP)[2, 3] for q in tared]
    assert min(heights) > SKIN + 0.9 * CLEARANCE
    assert sum(np.array_equal(q, away) for q in freely) == 2 * detour
    steady = table.time_on_stroke[table.in_loop] > 0.5
    assert np.abs(table.pressing_force[table.in_loop][steady] - 5.0).max() < 0.3
    assert table.s[table.in_loop][-1] == pytest.approx(2 * motion.s[-1], abs=1e-4)


def test_a_scan_that_was_cut_off_in_its_second_stroke_goes_on_there(motion):
    back = replace(motion, q=motion.q[::-1].copy(), qd=-motion.qd[::-1])
    both = joined([motion, back])
    start = len(motion.q) + len(motion.q) // 2
    robot, log = SpringRobot(motion.q_approach, SKIN), []
    execution.execute(robot, both, ContactConfig(), SafetyLimits(), log=log, start=start)
    table = scan_log.trajectory(log, both, robot)
    done = table.s[table.in_loop]
    assert done[0] == pytest.approx(both.s[start], abs=1e-4)
    assert done[-1] == pytest.approx(both.s[-1], abs=1e-4)


def test_a_path_in_the_air_never_touches(motion):
    robot, table, error = scan(motion, in_air=True)
    assert error is None
    assert phases_of(table) == ["travel", "retreat"]
    assert robot.largest_force == 0.0
    tip_x = table.X_BP[:, 0, 3]
    assert tip_x[-1] == pytest.approx(0.45 + motion.s[-1], abs=0.1e-3)


def test_a_start_outside_the_plan_is_refused(motion):
    robot = SpringRobot(motion.q_approach, SKIN)
    with pytest.raises(PlanningError, match="no row"):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits(), start=len(motion.q))


def test_skin_that_falls_away_is_searched_for_and_found(motion):
    """A step of 3 mm down under the running probe: contact is lost, and taken up where it was
    lost.
    """
    robot = SpringRobot(motion.q_approach, SKIN, 1000.0)
    send, log = robot.servo_joint, []

    def falling(q):
        robot.height = SKIN - (0.009 if robot.time > 5.5 else 0.0)
        send(q)

    robot.servo_joint = falling
    execution.execute(robot, motion, ContactConfig(), SafetyLimits(), log=log)
    table = scan_log.trajectory(log, motion, robot)
    assert "search" in phases_of(table)
    assert phases_of(table)[-3:] == ["loop", "lift", "retreat"]
    assert np.abs(loop_force(table)[-60:] - 5.0).max() < 0.1


def test_a_force_beyond_the_limit_ends_in_an_error_and_a_retreat(motion):
    robot = SpringRobot(motion.q_approach, SKIN, stiffness=1000.0)
    send, log = robot.servo_joint, []

    def hardening(q):
        robot.stiffness = 1000.0 + 40e3 * min(max(robot.time - 6.0, 0.0), 0.1)
        send(q)

    robot.servo_joint = hardening
    with pytest.raises(SafetyError, match="contact force"):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits(), log=log)
    assert (kinematics.forward(robot.q) @ X_FP)[2, 3] > SKIN + CLEARANCE - 1e-6
    assert robot.stopped
    assert scan_log.last_row(log) > 0


def test_a_real_ctrl_c_waits_for_the_end_of_a_command_and_a_second_one_does_not_end_the_retreat(
    motion,
):
    robot = SpringRobot(motion.q_approach, SKIN)
    send, commands = robot.servo_joint, 0

    def interrupted_inside_the_command(q):
        nonlocal commands
        commands += 1
        if commands in (575, 580):
            signal.raise_signal(signal.SIGINT)
        send(q)

    robot.servo_joint = interrupted_inside_the_command
    with pytest.raises(KeyboardInterrupt):
        execution.execute(robot, motion, ContactConfig(), SafetyLimits())
    assert commands > 580
    assert (kinematics.forward(robot.q) @ X_FP)[2, 3] > SKIN + CLEARANCE - 1e-6
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("deviation", [0.0, 1e-3])
def test_the_probe_is_lifted_up_its_axis_on_whatever_arm(motion, deviation):
    arm = KinematicCalibration.from_dh_corrections(
        **dict.fromkeys(("theta", "d", "a", "alpha"), np.full(6, deviation))
    )
    X_lifted = arm.forward(motion.q[100]) @ X_FP
    X_lifted[:3, 3] -= CLEARANCE * X_lifted[:3, 2]
    X_reached = arm.forward(motion.lifted(100, X_FP, arm)) @ X_FP
    np.testing.assert_allclose(X_reached, X_lifted, atol=1e-7)


CHEST_B = np.array([math.sin(0.6), 0.0, math.cos(0.6)])
"""The chest's outward normal, at .6 rad to the probe axis."""


INDENTATION = 0.0061
"""Of soft tissue, at 5 N [m]."""


class SoftRobot(SpringRobot):
    """A plane that is pressed as soft tissue is."""

    def _wrench(self):
        X_BP = kinematics.forward(self.q) @ self.X_FP
        depth = max(self.height - X_BP[2, 3], 0.0)
        force = 5.0 * (depth / INDENTATION) ** (1 / POWER)
        return np.concatenate([X_BP[:3, :3].T @ [0.0, 0.0, force], np.zeros(3)])


class BreathingRobot(SoftRobot):
    """The plane moves along the chest's normal, and with it every point of the skin."""

    def __init__(self, q, amplitude=0.004):
        super().__init__(q, SKIN)
        self.amplitude = amplitude
        self.slid = []
        """Where the tip is on the skin [m]."""

    def rise(self):
        return self.amplitude * (1.0 - math.cos(2.0 * math.pi * 0.25 * self.time))

    def servo_joint(self, q):
        self.height = SKIN + self.rise() * CHEST_B[2]
        super().servo_joint(q)
        tip_B = (kinematics.forward(self.q) @ self.X_FP)[:3, 3]
        self.slid.append(tip_B[0] - self.rise() * CHEST_B[0])


def _planned(table):
    """The tip by the planned angles, over the loop [m]."""
    return (kinematics.forward(table.q_plan[table.in_loop]) @ X_FP)[:, :3, 3]


def test_the_probe_breathes_along_with_a_chest_that_moves_at_an_angle_to_its_axis(motion):
    """Across the axis the chest moves by 4.5 mm."""
    errors = {}
    for chest_B in (None, CHEST_B):
        robot, log = BreathingRobot(motion.q_approach), []
        along = replace(motion, chest_normal_B=chest_B)
        execution.execute(robot, along, DEFAULTS, SafetyLimits(), log=log)
        table = scan_log.trajectory(log, motion, robot)
        slid = np.array([np.nan, *robot.slid])[-len(table.in_loop) :][table.in_loop]
        planned = _planned(table)[:, 0]
        errors[chest_B is None] = np.sqrt(np.mean((slid - planned) ** 2))
        assert np.abs(loop_force(table) - 5.0).max() < 0.3
    assert errors[False] < 1e-3
    assert errors[True] > 2.5 * errors[False]


def test_the_tip_goes_where_the_pressed_skin_is_dragged(motion):
    """By a fifth of the indentation to the side, from the settled contact on."""
    drag_B = np.tile([0.0, 0.2, 0.0], (len(motion.q), 1)) / math.sqrt(INDENTATION)
    robot, log = SoftRobot(motion.q_approach, SKIN), []
    dragged = replace(motion, drag_B=drag_B)
    execution.execute(robot, dragged, DEFAULTS, SafetyLimits(), log=log)
    table = scan_log.trajectory(log, motion, robot)
    executed = table.X_BP[table.in_loop, :3, 3] - _planned(table)
    np.testing.assert_allclose(executed[:, 1], 0.2 * INDENTATION, atol=0.1e-3)
    np.testing.assert_allclose(executed[:, 0], 0.0, atol=0.05e-3)
    assert table.tangential_errors_mm().max() < 0.05, "tracking counts from where it is to be"
    assert abs(table.X_BP[-1, 1, 3] - 0.13) < 0.1e-3


class LeaningRobot(BreathingRobot):
    """Its sensor tells of a tilt that does not go away, so that the probe turns as fast as it may
    to the end.
    """

    lean = 4.0
    """Force along y [N]."""

    def _wrench(self):
        wrench_P = super()._wrench()
        wrench_P[1] = self.lean * (wrench_P[2] < -0.5)
        return wrench_P


class LostRobot(LeaningRobot):
    """The skin falls away under it while the chest rises."""

    def servo_joint(self, q):
        if 5.5 < self.time < 5.6:
            self.amplitude = 0.0
        super().servo_joint(q)


class CaughtRobot(LeaningRobot):
    """Its sensor goes wild in mid-path."""

    def _wrench(self):
        return super()._wrench() + (30.0 if self.time > 5.5 else 0.0)


@pytest.mark.parametrize("paused_at", [None, 330, 390, 520], ids="paused at {}".format)
@pytest.mark.parametrize("kind", [LeaningRobot, LostRobot, CaughtRobot])
@pytest.mark.parametrize("late", [0, 4])
def test_no_correction_asks_for_an_acceleration_near_what_the_supervisor_refuses(
    motion, kind, paused_at, late
):
    """Breath, drag, tilt and force together, set in and ended in every way."""
    robot, targets = kind(motion.q_approach), []
    robot.servo = Servo.pure_delay(late * PERIOD)
    robot._waiting.extend([robot.q] * late)
    send, asked = robot.servo_joint, 0
    robot.servo_joint = lambda q: (targets.append(q), send(q))

    def pause():
        nonlocal asked
        asked += 1
        return paused_at is not None and paused_at < asked < paused_at + 300

    drag_B = np.tile([0.1, 0.2, 0.0], (len(motion.q), 1)) / math.sqrt(0.006)
    moving = replace(motion, chest_normal_B=CHEST_B, drag_B=drag_B)
    raised = None
    try:
        execution.execute(robot, moving, DEFAULTS, SafetyLimits(), pause=pause)
    except (RobotError, SafetyError) as error:
        raised = error
    assert (raised is None) == (kind is not CaughtRobot)
    assert "rad/s" not in str(raised)
    acceleration = np.abs(np.diff(targets, 2, axis=0)).max() / PERIOD**2
    assert acceleration < 0.5 * SafetyLimits().joint_acceleration
