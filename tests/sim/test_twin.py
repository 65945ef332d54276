"""The twin from Python, but for the scan of it, which tests/examples runs."""

import numpy as np
import pytest

from breastscan.errors import ConfigError
from sim import PhantomConfig, SceneConfig, Twin

PRINTED = SceneConfig(phantom=PhantomConfig(mechanics="printed"))


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
