import copy
import os
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.robot.interface import RobotState
from sim.cameras import picture
from sim.cameras.camera import SimStereoCamera
from sim.cameras.camera_errors import CameraConfig
from sim.cameras.picture import Picture
from sim.robot import SimRobot
from sim.scene import HOME_Q


class PassingRobot(SimRobot):
    """An arm that swings by at an even speed and is parked at 2 s."""

    def __init__(self, qd, time=2.0):
        self._state = RobotState(
            time=time, q=HOME_Q + qd * (time - 2.0), qd=qd, wrench_P=np.zeros(6), sample=0
        )

    def state(self):
        return self._state

    def snapshot(self):
        return self._state.q, None, self._state.time


@pytest.fixture(scope="module")
def pairs(quiet_scene):
    """One pair of two cameras each, set up alike."""
    taken = []
    for _ in range(2):
        camera = SimStereoCamera(quiet_scene)
        taken.append(camera.capture())
        camera.close()
    return taken


def test_pairs_have_the_rigs_size_and_repeat_to_the_last_bit(quiet_scene, pairs):
    first, second = pairs
    assert first.left.shape == (quiet_scene.rig.left.height, quiet_scene.rig.left.width)
    np.testing.assert_array_equal(first.left, second.left)
    np.testing.assert_array_equal(first.right, second.right)


def test_the_skin_is_well_exposed_in_both_views(quiet_scene, pairs):
    """Neither black nor burnt out: stereo needs its texture."""
    skin_B = se3.transform(quiet_scene.X_BS, quiet_scene.phantom.skin.vertices_S)
    rig = quiet_scene.rig
    for image, camera, X_BC in (
        (pairs[0].left, rig.left, quiet_scene.X_BL),
        (pairs[0].right, rig.right, quiet_scene.X_BR),
    ):
        X_CB = se3.inverse(X_BC)
        rotation, _ = cv2.Rodrigues(X_CB[:3, :3])
        pixels, _ = cv2.projectPoints(skin_B, rotation, X_CB[:3, 3], camera.K, camera.distortion)
        x, y = np.rint(pixels[:, 0]).astype(int).T
        grey = image[y, x]
        assert 60 < np.median(grey) < 200
        assert np.percentile(grey, 99.5) < 250


def capture(scene, config, robot, binning=4):
    """A pair of small images; the scene is not compiled anew for another camera."""
    scene = copy.copy(scene)
    scene.config = replace(scene.config, camera=config)
    camera = SimStereoCamera(scene, robot, binning=binning)
    pair = camera.capture()
    camera.close()
    return pair


def test_the_picture_of_a_moving_arm_is_the_mean_over_its_course(quiet_scene):
    """Four instants in the centres of the quarters of the exposure, which ends when the picture
    is taken.
    """
    ideal, swing = CameraConfig(quality="ideal"), np.array([6.0, 0, 0, 0, 0, 0])
    blurred = capture(quiet_scene, replace(ideal, motion_samples=4), PassingRobot(qd=swing))
    instants = 2.0 - ideal.exposure_time * (1 - (np.arange(4) + 0.5) / 4)
    sharp = [
        capture(quiet_scene, ideal, PassingRobot(qd=swing, time=instant)) for instant in instants
    ]
    assert blurred.time == 2.0
    for side in ("left", "right"):
        course = np.array([getattr(pair, side) for pair in sharp], float)
        assert np.ptp(course, axis=0).max() > 30
        np.testing.assert_allclose(getattr(blurred, side), course.mean(axis=0), atol=1.01)


def test_binned_pictures_are_the_full_ones_reduced(quiet_scene, pairs):
    """But for noise, and for what a coarser drawing makes of edges."""
    small = capture(quiet_scene, CameraConfig(quality="ideal"), None)
    for side in ("left", "right"):
        full = getattr(pairs[0], side)
        reduced = full.reshape(full.shape[0] // 4, 4, full.shape[1] // 4, 4).mean(axis=(1, 3))
        assert np.median(np.abs(getattr(small, side) - reduced)) < 1.5


def test_missing_opengl_is_said_in_words(quiet_scene, monkeypatch):
    def no_context(*_):
        raise RuntimeError("no EGL display")

    monkeypatch.setattr(picture.mujoco, "Renderer", no_context)
    with pytest.raises(ConfigError, match="libegl1") as caught:
        Picture(quiet_scene, 64, 48)
    assert "MUJOCO_GL" in str(caught.value)


def test_importing_the_twin_chooses_headless_drawing_without_a_display():
    environment = {k: v for k, v in os.environ.items() if k not in {"MUJOCO_GL", "DISPLAY"}}
    command = "import sim, os; print(os.environ['MUJOCO_GL'])"
    done = subprocess.run(
        [sys.executable, "-c", command], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "egl"
