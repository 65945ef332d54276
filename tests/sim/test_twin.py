"""The twin from Python, but for the scan of it, which tests/examples runs."""

import numpy as np
import pytest

from breastscan import execution, scan_log
from breastscan.control.contact import ContactConfig
from breastscan.control.phases import PhaseConfig
from breastscan.control.surface import SurfaceConfig
from breastscan.errors import ConfigError, RobotError
from breastscan.geometry import kinematics, se3
from breastscan.scan import ScanConfig
from sim import PhantomConfig, SceneConfig, Twin
from tests.twin_path import arc_motion

PRINTED = SceneConfig(phantom=PhantomConfig(mechanics="printed"))
OF_LOOP = {"executed_truth_rms_mm", "contact_fraction", "breathing_amplitude_mm"}
OF_BODY = {"force_any_peak_n", "clearance_body_min_mm"}


def test_the_arm_is_driven_period_by_period():
    with Twin(PRINTED) as twin:
        start = twin.robot.state()
        for k in range(100):
            twin.robot.servo_joint(start.q + np.deg2rad([0.02 * k, 0, 0, 0, 0, 0]))
        state = twin.robot.state()
    assert state.time == pytest.approx(start.time + 100 * twin.robot.period)
    assert np.rad2deg(state.q - start.q)[0] == pytest.approx(2.0, abs=0.5)


def test_the_seed_draws_what_the_scene_leaves_open():
    first, same, other = (Twin(PRINTED, seed=seed) for seed in (1, 1, 2))
    skins = [twin.scene.phantom.skin.vertices_S for twin in (first, same, other)]
    np.testing.assert_array_equal(skins[0], skins[1])
    assert np.abs(skins[0] - skins[2]).max() > 1e-4


def test_a_scan_may_be_shown_another_rig_than_the_cameras_are():
    twin = Twin(PRINTED)
    shown = Twin(PRINTED, rig=twin.cell.rig)
    assert shown.cell.rig is twin.cell.rig
    assert shown.scene.rig is not twin.cell.rig


def test_a_negative_seed_is_refused():
    with pytest.raises(ConfigError, match="whole number from 0 on"):
        Twin(seed=-1)


@pytest.fixture(scope="module")
def executed():
    """A print that was scanned over 40 mm, and what was done."""
    twin = Twin(PRINTED)
    contact = ContactConfig(
        phases=PhaseConfig(approach_speed=0.003), surface=SurfaceConfig(stiffness=7000.0)
    )
    config = ScanConfig(contact=contact)
    motion = arc_motion(twin.scene, twin.truth, length=0.04)
    log = execution.execute(twin.robot, motion, config.contact, config.safety)
    return twin, scan_log.trajectory(log, motion, twin.robot), config


def test_an_execution_is_held_against_the_truth(executed):
    twin, done, config = executed
    trajectory, metrics = twin.contact_metrics(done, config)
    assert metrics.keys() >= OF_LOOP | OF_BODY | {"force_rmse_n", "force_peak_n"}
    assert metrics["force_any_peak_n"] >= metrics["force_peak_n"]
    assert metrics["force_any_peak_n"] < 10.0
    # the print does not yield: its box begins 10 mm behind the face, and the skin falls away
    assert 8.0 < metrics["clearance_body_min_mm"] < 10.5
    assert metrics["breathing_amplitude_mm"] == 0.0
    assert trajectory.true_tilt is not None
    assert twin.touched_else is None


@pytest.mark.parametrize(("rows", "expected"), [(300, OF_LOOP), (0, set())])
def test_of_one_that_ended_early_what_can_be_said_is(executed, rows, expected):
    """After .6 s of the loop, in which the force is not yet judged; and before it."""
    twin, done, config = executed
    began = int(np.flatnonzero(done.in_loop)[0])
    trajectory, metrics = twin.contact_metrics(done.take(np.arange(began + rows)), config)
    assert metrics.keys() >= expected | OF_BODY
    assert "force_peak_n" not in metrics
    assert metrics.keys() & OF_LOOP == expected
    assert trajectory.true_force is not None


def test_an_error_is_explained_by_what_else_touched():
    """An arm sent 1 mm into the chest plate beside the breast tells only that something holds
    it.
    """
    twin = Twin(PRINTED)
    robot = twin.robot
    unexplained = RobotError("something else")
    with pytest.raises(RobotError, match="something holds it") as held:
        for height in (-0.009, -0.011):  # the box begins 10 mm behind the face
            X_SP = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([-0.13, 0.0, height]))
            solutions = kinematics.inverse(twin.scene.X_BS @ X_SP @ se3.inverse(robot.X_FP))
            nearest = np.abs(solutions - robot.state().q).max(axis=1).argmin()
            twin.explain(unexplained)
            robot.move_joint(solutions[nearest], 1.0, 3.0)
    twin.explain(held.value)
    assert not hasattr(unexplained, "__notes__")
    assert "the probe's body touched the chest plate" in held.value.__notes__[0]
