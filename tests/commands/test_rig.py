"""A rig is told as it is, and written so that others, and we, read the same."""

import cv2
import numpy as np
import pytest

from breastscan.commands.rig import rig
from breastscan.errors import CalibrationError
from breastscan.vision.camera import StereoRig
from tests.vision.rigs.test_reading import RIG, T, opencv, ros


def test_a_rig_is_told(tmp_path, capsys):
    rig(tuple(opencv(tmp_path)))
    told = capsys.readouterr().out
    for part in ("as OpenCV writes it", "Baseline [mm]", "98.99", "341.00 342.00", "320 x 240"):
        assert part in told
    assert "metres, not said" in told
    assert "breastscan handeye" in told
    vergence = np.degrees(np.arctan2(-RIG.X_RL[2, 0], RIG.X_RL[2, 2]))
    assert f"{vergence:.2f}" in told
    assert abs(abs(vergence) - 4.0) < 0.05


def test_what_is_written_is_read_as_the_same_rig(tmp_path):
    rig(tuple(ros(tmp_path)), out=tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "rig.yaml", "opencv.yaml", "left_camera_info.yaml", "right_camera_info.yaml",
    }  # fmt: skip
    for name in ("rig.yaml", "opencv.yaml", "left_camera_info.yaml"):
        read = StereoRig.load(tmp_path / "out" / name)
        np.testing.assert_allclose(read.X_RL, RIG.X_RL, atol=1e-12)
        np.testing.assert_allclose(read.right.distortion, RIG.right.distortion, atol=1e-12)
        assert (read.left.width, read.left.height) == (320, 240)
    file = cv2.FileStorage(str(tmp_path / "out" / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(file.getNode("T").mat().ravel(), T, atol=1e-12)


def test_a_unit_is_taken(tmp_path, capsys):
    files = tuple(opencv(tmp_path, T=1e3 * T[:, None]))
    rig(files, unit="mm", out=tmp_path / "out")
    assert "0.001 m" in capsys.readouterr().out
    assert StereoRig.load(tmp_path / "out" / "rig.yaml").baseline == pytest.approx(RIG.baseline)


def test_no_file_is_asked_for(tmp_path):
    with pytest.raises(CalibrationError, match="no rig file given"):
        rig(())
