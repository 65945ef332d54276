"""Whatever fails, the probe is retreated and the twin's true force stays below 15 N."""

import signal
from dataclasses import replace

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.phases import PhaseConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import RobotError, SafetyError
from breastscan.geometry import kinematics
from experiments import sections
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.tissue.printed import PrintedBreast
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from sim.wrist.wrench_sensor import WrenchSensorConfig
from tests.twin_path import arc_motion

CONFIG = ContactConfig(force=5.0, phases=PhaseConfig(approach_speed=0.02, settle_time=0.6))
RIGID = replace(
    CONFIG,
    phases=replace(CONFIG.phases, approach_speed=0.003),
    surface=replace(CONFIG.surface, stiffness=6000.0),
)
HIGHEST_FORCE = 15.0
IN_APPROACH = 0.15
IN_LOOP = 1.6
ON_PRINT = 5.0
"""When faults set in [s]: half-way to the skin, and well under way along the path."""


class FaultyRobot:
    """The twin's robot, with something that goes wrong from a time on [s], counted from the
    tare.
    """

    def __init__(
        self, robot, since=0.0, *, see=lambda state, held: state, late=0, refuse=0, interrupt=False
    ):
        self._robot = robot
        self._since = since
        self._see = see
        self._late = late
        self._refuse = refuse
        self._interrupt = interrupt
        self._tared, self._held = np.inf, None
        self.stops = 0

    def __getattr__(self, name):
        return getattr(self._robot, name)

    @property
    def failing(self):
        return self._robot.state().time - self._tared >= self._since

    def tare(self):
        self._robot.tare()
        self._tared = self._robot.state().time

    def state(self):
        state = self._robot.state()
        if not self.failing:
            self._held = state
            return state
        return self._see(state, self._held)

    def servo_joint(self, q):
        if self.failing and self._interrupt:
            self._interrupt = False
            signal.raise_signal(signal.SIGINT)
        if self.failing and self._refuse:
            self._refuse -= 1
            raise RobotError("protective stop")
        self._robot.servo_joint(q)
        while self.failing and self._late:
            self._late -= 1
            self._robot.servo_joint(q)

    def stop(self):
        self.stops += 1
        self._robot.stop()


class MovedTissue(SoftTissue):
    """The phantom, displaced by a vector in S [m] that depends on time [s]; one period passes
    from press to press.
    """

    def __init__(self, tissue, displacement):
        self._tissue = tissue
        self._displacement = displacement
        self._time = 0.0

    def press(self, X_SP, velocity_S):
        before, self._time = self._time, self._time + 0.002
        now_S = self._displacement(self._time)
        moved = X_SP.copy()
        moved[:3, 3] -= now_S
        return self._tissue.press(moved, velocity_S - (now_S - self._displacement(before)) / 0.002)


@pytest.fixture(scope="module")
def twin():
    """Scene by sensor class, tissue and truth."""
    scenes = {
        name: Scene(SceneConfig(wrist=WrenchSensorConfig(quality=name)))
        for name in ("industrial", "ideal")
    }
    tissue = SoftTissue.build(scenes["ideal"].phantom)
    return scenes, tissue, Truth(scenes["ideal"].phantom, tissue)


@pytest.fixture(scope="module")
def motion(twin):
    scenes, _, truth = twin
    return arc_motion(scenes["ideal"], truth, length=0.02)


def scan(twin, motion, *, sensor="industrial", tissue=None, config=CONFIG, **fault):
    """Run into a fault; its error, the robot, and the log."""
    scenes, soft, _ = twin
    soft.reset()
    simulated = SimRobot(scenes[sensor], tissue or soft, motion.q_approach)
    robot, log = FaultyRobot(simulated, **fault), []
    with pytest.raises((SafetyError, RobotError, KeyboardInterrupt)) as caught:
        execution.execute(robot, motion, config, SafetyLimits(), log=log)
    return caught.value, robot, log


def assert_retreated(robot, log):
    truth = robot.truth_log()
    assert truth.force_axial.max() < HIGHEST_FORCE
    assert truth.force_axial[-1] == 0.0
    assert log[-1].phase == "emergency retreat"
    assert robot.stops > 0


def frozen(state, held):
    return replace(state, wrench_P=held.wrench_P, sample=held.sample)


def repeating(state, held):
    return replace(state, wrench_P=held.wrench_P)


def jumping(newtons):
    return lambda state, held: replace(
        state, wrench_P=state.wrench_P - np.array([0, 0, newtons, 0, 0, 0])
    )


def silent(state, held):
    return held


@pytest.mark.parametrize("since", [IN_APPROACH, IN_LOOP])
@pytest.mark.parametrize(
    ("sensor", "see", "why"),
    [
        ("industrial", frozen, "no new sample"),
        ("ideal", frozen, "no new sample"),
        ("ideal", repeating, "repeats the same wrench"),
        ("industrial", jumping(20.0), "jumped|above the limit"),
        ("industrial", jumping(-20.0), "jumped"),
        ("industrial", jumping(np.nan), "not finite"),
        ("industrial", silent, "no new state"),
    ],
)
def test_a_sensor_that_fails_ends_in_a_retreat(twin, motion, since, sensor, see, why):
    error, robot, log = scan(twin, motion, since=since, sensor=sensor, see=see)
    assert_retreated(robot, log)
    assert any(word in str(error) for word in why.split("|"))


def test_a_deadline_missed_by_twenty_milliseconds_ends_in_a_retreat(twin, motion):
    error, robot, log = scan(twin, motion, since=IN_LOOP, late=10)
    assert_retreated(robot, log)
    assert "missed its deadline by 20 ms" in str(error)


def test_ctrl_c_in_contact_ends_in_a_retreat(twin, motion):
    error, robot, log = scan(twin, motion, since=IN_LOOP, interrupt=True)
    assert_retreated(robot, log)
    assert isinstance(error, KeyboardInterrupt)


def test_a_refused_command_stops_and_retreats_once_commands_are_taken_again(twin, motion):
    error, robot, log = scan(twin, motion, since=IN_LOOP, refuse=5)
    assert_retreated(robot, log)
    assert str(error) == "protective stop"
    assert robot.stops >= 5


def test_a_robot_that_never_takes_commands_again_is_stopped_and_told(twin, motion):
    error, robot, _ = scan(twin, motion, since=IN_LOOP, refuse=10**6)
    assert robot.truth_log().force_axial.max() < HIGHEST_FORCE
    assert "protective stop; the robot takes no commands" in str(error)


def minimum_jerk(share):
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_phantom_that_moves_20_mm_in_a_second_ends_in_a_retreat(twin, motion, sign):
    scenes, soft, _ = twin
    outward_S = -(scenes["ideal"].X_BS[:3, :3].T @ _axis_B(scenes["ideal"], motion))
    moved = MovedTissue(soft, lambda t: sign * 0.02 * minimum_jerk(t - 1.9) * outward_S)
    error, robot, log = scan(twin, motion, tissue=moved)
    assert_retreated(robot, log)
    assert "mm/s" in str(error) or "contact" in str(error)


@pytest.mark.parametrize(
    ("height", "why"), [(0.015, "before where it was planned"), (-0.5, "no contact within")]
)
def test_skin_that_is_elsewhere_at_the_approach_ends_in_a_retreat(twin, height, why):
    scenes, soft, truth = twin
    motion = arc_motion(scenes["ideal"], truth, length=0.02, clearance=0.03)
    outward_S = -(scenes["ideal"].X_BS[:3, :3].T @ _axis_B(scenes["ideal"], motion))
    error, robot, log = scan(twin, motion, tissue=MovedTissue(soft, lambda t: height * outward_S))
    assert_retreated(robot, log)
    assert why in str(error)


def test_skin_that_comes_15_mm_nearer_over_50_mm_of_path_ends_in_a_retreat(twin):
    scenes, _, truth = twin
    planned = arc_motion(scenes["ideal"], truth, length=0.06)
    deeper = sections.ramp(planned.s, 0.015, start=0.005, length=0.05)
    motion = sections.misplaced(planned, scenes["ideal"].X_FP, deeper)
    error, robot, log = scan(twin, motion)
    assert_retreated(robot, log)
    assert "14 mm above where it was planned" in str(error)


@pytest.fixture
def rigid(twin):
    scenes, _, _ = twin
    return PrintedBreast(scenes["ideal"].phantom)


@pytest.mark.parametrize(
    "fault",
    [
        {"see": frozen},
        {"see": silent},
        {"see": jumping(20.0)},
        {"see": jumping(np.nan)},
        {"late": 10},
        {"interrupt": True},
    ],
)
def test_on_a_rigid_print_faults_end_in_a_retreat_as_well(twin, motion, rigid, fault):
    _, robot, log = scan(twin, motion, tissue=rigid, config=RIGID, since=ON_PRINT, **fault)
    assert any(entry.phase == "loop" for entry in log)
    assert_retreated(robot, log)


def test_a_rigid_print_that_is_taken_for_soft_is_found_out(twin, motion, rigid):
    """Approached slowly, the probe bounces a few times until the stiffness is believed; then the
    scan goes on.
    """
    scenes, _, _ = twin
    robot = SimRobot(scenes["industrial"], rigid, motion.q_approach)
    log = execution.execute(robot, motion, replace(CONFIG, phases=RIGID.phases), SafetyLimits())
    assert robot.truth_log().force_axial.max() < SafetyLimits().force
    assert scan_log.last_row(log) == len(motion.q) - 1


def test_a_rigid_print_that_is_approached_fast_is_left(twin, motion, rigid):
    error, robot, log = scan(twin, motion, tissue=rigid)
    assert_retreated(robot, log)
    assert "above the limit" in str(error)


def _axis_B(scene, motion):
    """The probe's axis at the first point of the path."""
    return (kinematics.forward(motion.q[0]) @ scene.X_FP)[:3, 2]
