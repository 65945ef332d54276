"""Two video devices, played from films whose every picture tells its number by its shade."""

import cv2
import numpy as np
import pytest

from breastscan.camera import video
from breastscan.camera.interface import StereoCamera
from breastscan.camera.video import MAX_SKEW, VideoCamera
from breastscan.errors import ConfigError, PerceptionError

SHADE = 4
"""Grey levels from one picture to the next."""


def film(path, rate, pictures=60):
    """A film of flat pictures at `rate` [1/s], the k-th of grey level `SHADE` k."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (64, 48))
    for k in range(pictures):
        writer.write(np.full((48, 64, 3), SHADE * k, np.uint8))
    writer.release()
    return str(path)


def number(image):
    """Which picture of its film this is."""
    return round(float(image.mean()) / SHADE)


def test_pictures_come_in_turn_with_rising_times(tmp_path):
    camera = VideoCamera(film(tmp_path / "left.avi", 25.0), film(tmp_path / "right.avi", 25.0))
    assert isinstance(camera, StereoCamera)
    pairs = [camera.capture() for _ in range(10)]
    assert (
        [number(pair.left) for pair in pairs]
        == [number(pair.right) for pair in pairs]
        == list(range(10))
    )
    assert np.diff([pair.time for pair in pairs[1:]]) == pytest.approx(0.04, abs=1e-6)
    assert pairs[0].left.shape == (48, 64)


def test_cameras_of_different_rates_are_matched_by_their_times(tmp_path):
    """At 25 and at 10 pictures a second every fifth of one and every second of the other are of
    one instant.
    """
    camera = VideoCamera(film(tmp_path / "left.avi", 25.0), film(tmp_path / "right.avi", 10.0))
    camera.capture()
    for _ in range(4):
        pair = camera.capture()
        assert abs(camera.skew) <= MAX_SKEW
        assert number(pair.left) / 25.0 == pytest.approx(number(pair.right) / 10.0, abs=MAX_SKEW)


def test_pictures_that_never_come_together_are_refused_with_their_skew(tmp_path, monkeypatch):
    left, right = film(tmp_path / "left.avi", 25.0), film(tmp_path / "right.avi", 24.9)
    monkeypatch.setattr(video, "MAX_SKEW", 1e-6)
    camera = VideoCamera(left, right)
    with pytest.raises(PerceptionError, match="ms apart"):
        for _ in range(3):
            camera.capture()


def test_a_film_that_is_over_is_told(tmp_path):
    camera = VideoCamera(
        film(tmp_path / "left.avi", 25.0, 3), film(tmp_path / "right.avi", 25.0, 3)
    )
    for _ in range(3):
        camera.capture()
    with pytest.raises(PerceptionError, match="gives no picture"):
        camera.capture()


def test_a_device_that_is_not_there_and_one_device_for_both_are_refused(tmp_path):
    with pytest.raises(PerceptionError, match="does not open"):
        VideoCamera(str(tmp_path / "a.avi"), str(tmp_path / "b.avi"))
    with pytest.raises(ConfigError, match="one device"):
        VideoCamera(0, 0)
