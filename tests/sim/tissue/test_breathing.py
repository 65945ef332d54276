"""The chest's motion, and that everything in the twin follows it."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.geometry import kinematics, se3
from sim.cameras.picture import Picture
from sim.cameras.video import CLOSE_UP
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene
from sim.tissue.breathing import BreathingConfig, rise, rising_speed
from tests.sim.tissue.closed_form_tissue import SpringTissue

DEEP = BreathingConfig(amplitude=0.005, rate=0.25)


@pytest.mark.parametrize("waveform", ["sine", "cos4"])
def test_a_breath_rises_from_rest_by_twice_the_amplitude_and_comes_back(waveform):
    config = replace(DEEP, waveform=waveform)
    time = np.linspace(0, 4, 401)
    height = np.array([rise(config, t) for t in time])
    assert height[0] == pytest.approx(0, abs=1e-12)
    assert height[-1] == pytest.approx(0, abs=1e-12)
    assert height.max() == pytest.approx(0.010, abs=1e-12)
    speed = np.array([rising_speed(config, t) for t in time])
    np.testing.assert_allclose(np.gradient(height, time)[1:-1], speed[1:-1], atol=5e-6)


@pytest.mark.parametrize("waveform", ["sine", "cos4"])
def test_the_phase_is_where_in_the_breath_the_clock_starts(waveform):
    config = replace(DEEP, waveform=waveform)
    later = replace(config, phase=0.3)
    for t in (0.0, 0.7, 2.9):
        assert rise(later, t) == pytest.approx(rise(config, t + 0.3 / DEEP.rate), abs=1e-12)
        assert rising_speed(later, t) == pytest.approx(
            rising_speed(config, t + 0.3 / DEEP.rate), abs=1e-12
        )
    assert rise(replace(config, phase=0.5), 0.0) == pytest.approx(2 * DEEP.amplitude)


def test_the_fourth_power_dwells_at_the_end_of_the_exhalation():
    time = np.linspace(0, 4, 400, endpoint=False)
    low = {
        waveform: np.mean([rise(replace(DEEP, waveform=waveform), t) < 0.001 for t in time])
        for waveform in ("sine", "cos4")
    }
    assert low["cos4"] > 1.5 * low["sine"]


@pytest.mark.parametrize(
    "change", [{"amplitude": -0.001}, {"amplitude": 0.5}, {"rate": 0.0}, {"phase": 1.5}]
)
def test_breaths_that_nobody_takes_are_refused(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        BreathingConfig(**change)


@pytest.fixture(scope="module")
def breathing_scene(quiet_scene) -> Scene:
    return Scene(replace(quiet_scene.config, breathing=DEEP))


def test_a_probe_held_still_is_pressed_as_the_chest_comes_up(breathing_scene):
    """A spring under the parked probe's tip, which touches at 5 mm of rise."""
    tip_S = (se3.inverse(breathing_scene.X_BS) @ kinematics.forward(HOME_Q) @ breathing_scene.X_FP)[
        :3, 3
    ]
    robot = SimRobot(breathing_scene, SpringTissue(height=tip_S[2] - 0.005, stiffness=200.0))
    while robot.state().time < 2.0:
        robot.servo_joint(HOME_Q)
    truth = robot.truth_log()
    heights = np.array([rise(DEEP, t) for t in truth.time])
    np.testing.assert_allclose(truth.X_SP[:, 2, 3], tip_S[2] - heights, atol=2e-4)
    np.testing.assert_allclose(truth.depth, np.maximum(heights - 0.005, 0), atol=2e-4)
    assert truth.force_S[-1, 2] == pytest.approx(1.0, abs=0.05)


def test_the_tissue_feels_the_chests_speed(breathing_scene):
    speeds: list[float] = []

    class Speedometer(SpringTissue):
        def press(self, X_SP, velocity_S):
            speeds.append(float(velocity_S[2]))
            return super().press(X_SP, velocity_S)

    robot = SimRobot(breathing_scene, Speedometer(height=-1.0, stiffness=1.0))
    while robot.state().time < 1.0:
        robot.servo_joint(HOME_Q)
    assert speeds[-1] == pytest.approx(-rising_speed(DEEP, robot.state().time), abs=2e-4)


def test_pictures_show_the_chest_where_it_is_at_their_instant(breathing_scene):
    """10 mm up, seen from 10 mm higher, the breast looks as it did at rest."""
    higher = replace(CLOSE_UP, target_B=tuple(np.add(CLOSE_UP.target_B, (0, 0, 0.010))))
    with closing(Picture(breathing_scene, 320, 240, shadows=False)) as picture:
        drawn = []
        for time, view in ((0.0, CLOSE_UP), (2.0, higher), (2.0, CLOSE_UP)):
            picture.arrange(HOME_Q, breathing_scene.phantom.skin.vertices_S, time)
            drawn.append(picture.draw(view.camera())[110:180, 100:220].astype(float))
    at_rest, followed, left_behind = drawn
    assert np.abs(followed - at_rest).mean() < 0.5
    assert np.abs(left_behind - at_rest).mean() > 3
