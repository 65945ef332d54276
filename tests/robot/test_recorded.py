"""A recording answers what it was asked once, and says where another run parts from it."""

import dataclasses

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.safety import SafetyLimits
from breastscan.errors import ConfigError, RobotError
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning.motion import Motion
from breastscan.robot.recorded import READ, RecordedRobot
from breastscan.run.trajectory import Sample
from sim.robot import SimRobot
from sim.scene import Scene
from sim.tissue.soft import SoftTissue
from sim.truth import Truth
from tests.robot.contract import RobotContract, send, stream
from tests.twin_path import arc_motion

FORCE = ContactConfig()


@pytest.fixture(scope="module")
def scene():
    return Scene()


def recorded(robot, targets):
    """What a recording is read from: a row before the first command, and one after each."""
    states = [robot.state(), *send(robot, targets)]
    sent = [states[0].q, *targets]
    log = [
        Sample(state.time, "travel", np.nan, state.q, state.qd, target, state.wrench_P, False)
        for state, target in zip(states, sent, strict=True)
    ]
    nowhere = Motion(
        q=np.zeros((2, 6)),
        qd=np.zeros((2, 6)),
        s=np.zeros(2),
        q_approach=np.zeros(6),
        clearance=0.01,
    )
    return scan_log.trajectory(log, nowhere, robot)


@pytest.fixture(scope="module")
def recording(scene):
    robot = SimRobot(scene)
    return recorded(robot, stream(RobotContract.Q_START, robot.period))


class TestRecordedRobot(RobotContract):
    PLAYS_BACK = True

    @pytest.fixture
    def robot(self, recording):
        return RecordedRobot(recording)

    def test_states_are_those_of_the_rows(self, robot, recording):
        states = [robot.state(), *send(robot, recording.target[1:])]
        np.testing.assert_array_equal([state.q for state in states], recording.q)
        np.testing.assert_array_equal([state.wrench_P for state in states], recording.wrench_P)
        assert robot.rows_left == 0

    def test_a_run_that_goes_on_for_longer_is_told_so(self, robot, recording):
        targets = recording.target[1:]
        send(robot, targets)
        with pytest.raises(RobotError, match=f"ends after {len(targets)} commands"):
            robot.servo_joint(targets[-1])

    def test_the_place_where_the_runs_part_is_named_with_its_joint(self, robot, recording):
        targets = recording.target[1:].copy()
        targets[200:, 3] += 0.01
        with pytest.raises(RobotError, match=r"part at command 200, 0\.40\d s: joint 4"):
            send(robot, targets)

    @pytest.mark.parametrize("name", READ)
    def test_a_number_that_is_none_is_named(self, recording, name):
        values = getattr(recording, name).copy()
        values[3] = np.nan
        with pytest.raises(ConfigError, match=f"{name} of the recording .* not finite"):
            RecordedRobot(dataclasses.replace(recording, **{name: values}))

    def test_an_arm_of_other_kinematics_is_noticed(self, recording):
        other = KinematicCalibration.from_dh_corrections(
            theta=np.full(6, 1e-3), d=np.zeros(6), a=np.zeros(6), alpha=np.zeros(6)
        )
        with pytest.raises(ConfigError, match="kinematic calibration"):
            RecordedRobot(recording, calibration=other)

    @pytest.mark.parametrize(("change", "why"), [(slice(0, 1), "1 rows"), (slice(0, 0), "0 rows")])
    def test_a_recording_of_nothing_is_refused(self, recording, change, why):
        with pytest.raises(ConfigError, match=why):
            RecordedRobot(recording.take(np.arange(len(recording.t))[change]))


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"not a run.*trajectory\.parquet"):
        RecordedRobot.load(tmp_path)
    (tmp_path / "trajectory.parquet").write_text("no table")
    with pytest.raises(ConfigError, match="not a Parquet file"):
        RecordedRobot.load(tmp_path)


@pytest.fixture(scope="module")
def scanned(scene, tmp_path_factory):
    """A short contact scan of the twin: the plan and the folder of its trajectory."""
    tissue = SoftTissue.build(scene.phantom)
    motion = arc_motion(scene, Truth(scene.phantom, tissue), length=0.03)
    robot = SimRobot(scene, tissue, motion.q_approach)
    log = execution.execute(robot, motion, FORCE, SafetyLimits())
    folder = tmp_path_factory.mktemp("run")
    scan_log.trajectory(log, motion, robot).save(folder / "trajectory.parquet")
    return motion, folder


def test_the_same_controller_runs_through_its_own_recording_to_a_micro_radian(scene, scanned):
    """Nothing that matters to it is missing in the log."""
    motion, folder = scanned
    robot = RecordedRobot.load(folder, servo=SimRobot(scene).servo, tolerance=1e-6)
    execution.execute(robot, motion, FORCE, SafetyLimits(), log=[])
    assert robot.rows_left == 0


def test_the_lag_is_fitted_to_a_tenth_of_a_millisecond(scene, scanned):
    assert RecordedRobot.load(scanned[1]).servo.lag == pytest.approx(
        SimRobot(scene).servo.lag, abs=1e-4
    )


def test_a_controller_with_another_set_point_parts_from_the_recording(scanned):
    motion, folder = scanned
    with pytest.raises(RobotError, match="the runs part at command"):
        execution.execute(
            RecordedRobot.load(folder),
            motion,
            dataclasses.replace(FORCE, force=4.0),
            SafetyLimits(),
            log=[],
        )
