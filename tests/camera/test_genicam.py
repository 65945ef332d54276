"""Two GenICam cameras behind the interface of harvesters, whose parts stand here for a producer
and its cameras.
"""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from breastscan.camera import genicam as genicam_camera
from breastscan.camera.genicam import GenicamCamera, load_producer
from breastscan.camera.interface import StereoCamera
from breastscan.errors import ConfigError, PerceptionError


class Buffer:
    """One picture in the driver's memory, which is written over once the buffer is given back."""

    def __init__(self, shade, data_format):
        self.data = np.full(6 * 8, shade, np.uint8)
        picture = SimpleNamespace(data_format=data_format, width=8, height=6, data=self.data)
        self.payload = SimpleNamespace(components=[picture])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.data[:] = 255


class Camera:
    def __init__(self, shade):
        self.shade = shade
        self.triggered = 0
        self.running = False
        self.gone = False
        self.data_format = "Mono8"
        features = ("PixelFormat", "TriggerSelector", "TriggerMode", "TriggerSource")
        self.features = {name: SimpleNamespace(value=None) for name in features}
        nodes = SimpleNamespace(
            **self.features, TriggerSoftware=SimpleNamespace(execute=self.trigger)
        )
        self.remote_device = SimpleNamespace(node_map=nodes)

    def start(self):
        self.running = True

    def trigger(self):
        self.triggered += 1

    def try_fetch(self, *, timeout):
        if not (self.running and self.triggered):
            return None
        self.triggered -= 1
        return Buffer(self.shade, self.data_format)

    def stop(self):
        self.running = False

    def destroy(self):
        self.gone = True


class Harvester:
    def __init__(self, *serials):
        self.device_info_list = [SimpleNamespace(serial_number=serial) for serial in serials]
        self.cameras = {serial: Camera(10 * (k + 1)) for k, serial in enumerate(serials)}
        self.is_reset = False

    def create(self, search):
        return self.cameras[search["serial_number"]]

    def reset(self):
        self.is_reset = True


def shades(pair):
    return int(pair.left.max()), int(pair.right.max())


def test_a_pair_is_triggered_fetched_and_kept():
    harvester = Harvester("A", "B")
    camera = GenicamCamera(harvester)
    assert isinstance(camera, StereoCamera)
    pair, later = camera.capture(), camera.capture()
    assert shades(pair) == shades(later) == (10, 20)
    assert pair.left.shape == (6, 8)
    assert 0 <= camera.skew < later.time - pair.time
    assert {name: feature.value for name, feature in harvester.cameras["B"].features.items()} == {
        "PixelFormat": "Mono8",
        "TriggerSelector": "FrameStart",
        "TriggerMode": "On",
        "TriggerSource": "Software",
    }


def test_serial_numbers_say_which_is_left():
    assert shades(GenicamCamera(Harvester("A", "B", "C"), ("C", "A")).capture()) == (30, 10)


def test_cameras_that_are_not_there_are_named_beside_those_that_are():
    with pytest.raises(PerceptionError, match="expected two cameras, the producer finds A"):
        GenicamCamera(Harvester("A"))
    with pytest.raises(PerceptionError, match="cameras A and X, the producer finds A, B"):
        GenicamCamera(Harvester("A", "B"), ("A", "X"))


def test_a_picture_that_does_not_come_is_told_with_its_camera():
    harvester = Harvester("A", "B")
    camera = GenicamCamera(harvester)
    harvester.cameras["B"].running = False
    with pytest.raises(PerceptionError, match="camera B gave no picture"):
        camera.capture()


def test_another_pixel_format_is_refused():
    harvester = Harvester("A", "B")
    harvester.cameras["A"].data_format = "BayerRG8"
    with pytest.raises(PerceptionError, match="camera A gives BayerRG8"):
        GenicamCamera(harvester).capture()


def test_triggers_too_far_apart_are_refused(monkeypatch):
    clock = iter([1.0, 1.02])
    monkeypatch.setattr(genicam_camera.time, "monotonic", lambda: next(clock))
    with pytest.raises(PerceptionError, match=r"20\.0 ms apart"):
        GenicamCamera(Harvester("A", "B")).capture()


def test_a_camera_that_nobody_holds_any_more_is_let_go():
    harvester = Harvester("A", "B")
    camera = GenicamCamera(harvester)
    del camera
    assert all(camera.gone and not camera.running for camera in harvester.cameras.values())
    assert harvester.is_reset


def test_a_missing_library_is_named_with_its_cure(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "harvesters.core", None)
    with pytest.raises(ConfigError, match=r"pip install 'breastscan\[genicam\]'"):
        load_producer(tmp_path / "vendor.cti")


def test_a_missing_producer_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "harvesters", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "harvesters.core", SimpleNamespace(Harvester=Harvester))
    with pytest.raises(ConfigError, match=r"vendor\.cti"):
        load_producer(tmp_path / "vendor.cti")
