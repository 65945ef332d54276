"""An option's string names a camera, or the error says how."""

import cv2
import numpy as np
import pytest

from breastscan.camera import choice as cameras
from breastscan.camera.choice import FORMS, open_camera
from breastscan.camera.folder import FolderCamera
from breastscan.errors import ConfigError, PerceptionError


def test_a_folder_is_opened_whatever_its_name_holds(tmp_path):
    folder = tmp_path / "a,b:c"
    folder.mkdir()
    for name in ("left.png", "right.png"):
        cv2.imwrite(str(folder / name), np.zeros((4, 4), np.uint8))
    assert isinstance(open_camera(f"folder:{folder}"), FolderCamera)


def test_devices_and_serial_numbers_keep_their_order(monkeypatch):
    monkeypatch.setattr(cameras, "VideoCamera", lambda left, right: ("video", left, right))
    monkeypatch.setattr(
        cameras, "GenicamCamera", lambda producer, serials: ("genicam", producer, serials)
    )
    monkeypatch.setattr(cameras, "load_producer", str)
    assert open_camera("devices:2,0") == ("video", 2, 0)
    assert open_camera("genicam:vendor.cti") == ("genicam", "vendor.cti", None)
    assert open_camera("genicam:vendor.cti,R2,L1") == ("genicam", "vendor.cti", ("R2", "L1"))


@pytest.mark.parametrize(
    "option",
    [
        "",
        "twin",
        "folder:",
        "devices:0",
        "devices:0,x",
        "devices:0,1,2",
        "genicam:",
        "genicam:a.cti,L",
    ],
)
def test_any_other_string_is_refused_with_the_forms(option):
    with pytest.raises(ConfigError) as caught:
        open_camera(option)
    assert FORMS in str(caught.value)


def test_a_folder_that_is_not_there_is_a_matter_of_perception(tmp_path):
    with pytest.raises(PerceptionError):
        open_camera(f"folder:{tmp_path / 'nowhere'}")
