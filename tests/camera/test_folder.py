"""Pairs on disk: what belongs together, in which order, and what is refused."""

import os

import cv2
import numpy as np
import pytest

from breastscan.camera.folder import FolderCamera
from breastscan.camera.interface import StereoCamera
from breastscan.errors import PerceptionError


def picture(path, shade):
    cv2.imwrite(str(path), np.full((6, 8), shade, np.uint8))


def test_pairs_come_by_the_time_in_their_names(tmp_path):
    for time, shade in (("10.5", 30), ("9.25", 20), ("2.0", 10)):
        picture(tmp_path / f"left_{time}.png", shade)
        picture(tmp_path / f"right_{time}.png", shade + 1)
    camera = FolderCamera(tmp_path)
    assert isinstance(camera, StereoCamera)
    pairs = [camera.capture() for _ in range(len(camera))]
    assert [pair.time for pair in pairs] == [2.0, 9.25, 10.5]
    assert [(int(pair.left[0, 0]), int(pair.right[0, 0])) for pair in pairs] == [
        (10, 11),
        (20, 21),
        (30, 31),
    ]


@pytest.mark.parametrize(
    ("left", "right"),
    [("left.png", "right.png"), ("a_left.bmp", "a_right.png"), ("left7.tif", "right7.tif")],
)
def test_files_that_differ_in_left_and_right_alone_are_a_pair_timed_by_the_left_one(
    tmp_path, left, right
):
    picture(tmp_path / left, 40)
    picture(tmp_path / right, 50)
    os.utime(tmp_path / left, (1234.5, 1234.5))
    pair = FolderCamera(tmp_path).capture()
    assert (int(pair.left[0, 0]), int(pair.right[0, 0])) == (40, 50)
    assert pair.time == 1234.5


def test_a_folder_that_is_used_up_says_so(tmp_path):
    picture(tmp_path / "left.png", 1)
    picture(tmp_path / "right.png", 1)
    camera = FolderCamera(tmp_path)
    camera.capture()
    with pytest.raises(PerceptionError, match="all 1 pairs"):
        camera.capture()


def test_a_picture_without_its_partner_is_named(tmp_path):
    picture(tmp_path / "left_1.png", 1)
    picture(tmp_path / "right_1.png", 1)
    picture(tmp_path / "right_2.png", 1)
    with pytest.raises(PerceptionError, match=r"right_2\.png has no partner"):
        FolderCamera(tmp_path)


def test_a_folder_without_pairs_and_no_folder_are_refused(tmp_path):
    with pytest.raises(PerceptionError, match="no pairs"):
        FolderCamera(tmp_path)
    with pytest.raises(PerceptionError, match="no folder"):
        FolderCamera(tmp_path / "nowhere")


def test_a_damaged_picture_is_refused_when_its_turn_comes(tmp_path):
    picture(tmp_path / "right.png", 1)
    (tmp_path / "left.png").write_bytes(b"no picture")
    with pytest.raises(PerceptionError, match="damaged"):
        FolderCamera(tmp_path).capture()
