"""The sensor by the methods that characterise a real one (EMVA 1288): flat fields, means and
variances.
"""

import numpy as np
import pytest

from sim.cameras.camera_errors import FULL_WELL, CameraConfig
from sim.cameras.sensor import expose

GREY_PER_ELECTRON = 255 / FULL_WELL


def flat(level, **settings):
    """Grey levels of an evenly lit image."""
    config = CameraConfig(**{"quality": "ideal", **settings})
    light = np.full((400, 500), level, np.float32)
    return expose(light, config, np.random.default_rng(0)).astype(float)


def test_an_ideal_camera_only_rounds():
    light = np.random.default_rng(0).uniform(0, 255, (50, 60)).astype(np.float32)
    seen = expose(light, CameraConfig(quality="ideal"), np.random.default_rng(0))
    np.testing.assert_array_equal(seen, np.rint(light))


def test_one_grey_level_is_noise_of_one_grey_level_at_any_brightness():
    for level in (60.0, 180.0):
        seen = flat(level, quality="one_grey_level")
        assert seen.mean() == pytest.approx(level, abs=0.02)
        assert seen.std() == pytest.approx(np.hypot(1.0, np.sqrt(1 / 12)), rel=0.02)


@pytest.mark.parametrize("gain", [1.0, 2.0])
def test_the_photon_transfer_curve_gives_gain_and_read_noise_back(gain):
    """Variance against mean is a line: its slope is the grey level of an electron, its foot the
    read-out's noise.
    """
    read_noise = 30.0
    levels = np.linspace(20, 100, 9)
    images = [flat(level, shot_noise=True, read_noise=read_noise, gain=gain) for level in levels]
    mean, variance = np.array([[image.mean(), image.var()] for image in images]).T
    slope, foot = np.polyfit(mean, variance - 1 / 12, 1)
    assert slope == pytest.approx(gain * GREY_PER_ELECTRON, rel=0.02)
    assert np.sqrt(foot) == pytest.approx(gain * GREY_PER_ELECTRON * read_noise, rel=0.05)


def test_shot_noise_alone_vanishes_in_the_dark():
    assert flat(0.0, shot_noise=True).max() == 0


def test_read_noise_alone_is_the_same_everywhere():
    dark, bright = (flat(level, read_noise=60.0).var() for level in (50.0, 200.0))
    assert dark == pytest.approx(bright, rel=0.02)


def test_half_the_exposure_at_twice_the_gain_is_as_bright_and_root_two_noisier():
    full, short = (
        flat(100.0, shot_noise=True),
        flat(100.0, shot_noise=True, exposure_time=2.5e-3, gain=2.0),
    )
    assert short.mean() == pytest.approx(full.mean(), abs=0.05)
    assert short.std() == pytest.approx(np.sqrt(2) * full.std(), rel=0.02)


def test_a_full_pixel_is_white_and_no_brighter():
    assert flat(300.0).min() == 255
    assert flat(200.0, exposure_time=20e-3).min() == 255


def test_ten_bits_lose_their_lowest_two():
    """A ramp over one grey level: 8 bits round it, 10 bits cut it off."""
    light = np.linspace(100, 101, 101, dtype=np.float32)[None, :]
    rounded, cut = (
        expose(light, CameraConfig(quality="ideal", bits=bits), np.random.default_rng(0))
        for bits in (8, 10)
    )
    assert (rounded == 101).mean() == pytest.approx(0.5, abs=0.02)
    codes = np.rint(light.astype(float) * 1023 / 255)
    np.testing.assert_array_equal(cut, codes // 4)


def test_exposures_repeat_to_the_last_bit():
    np.testing.assert_array_equal(
        flat(100.0, quality="realistic"), flat(100.0, quality="realistic")
    )
