"""Both calibrations from folders on disk: what they write, and what they say of damaged input."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from breastscan import cli
from breastscan.camera.interface import StereoPair
from breastscan.commands import shots
from breastscan.commands.calibrate import calibrate
from breastscan.commands.handeye import handeye
from breastscan.errors import CalibrationError, PerceptionError
from breastscan.geometry import se3
from breastscan.vision.boards import poses_table
from breastscan.vision.boards.calibration_quality import QualityLimits
from breastscan.vision.camera import StereoRig
from tests.vision.board_shots import BOARD, SIZE, flange_poses, make_rig, picture, poses_in_view

X_FBoard = se3.pose(np.eye(3), np.array([-0.27, -0.05, 0.12]))


@pytest.fixture(scope="module")
def rig():
    return make_rig(distorted=False)


@pytest.fixture(scope="module")
def rig_file(rig, tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    rig.save(path)
    return path


def write_pictures(folder, rig, X_LBoard):
    for number, X in enumerate(X_LBoard):
        pair = StereoPair(
            left=picture(rig.left, X), right=picture(rig.right, rig.X_RL @ X), time=0.0
        )
        shots.write_shot(folder, f"{number:02d}", pair)


@pytest.fixture(scope="module")
def board_folder(rig, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shots")
    write_pictures(folder, rig, poses_in_view(rig, 16, np.random.default_rng(0)))
    return folder


@pytest.fixture(scope="module")
def flange_folder(rig, tmp_path_factory):
    folder = tmp_path_factory.mktemp("poses")
    X_BF = flange_poses(rig, X_FBoard, 14, np.random.default_rng(0))
    write_pictures(folder, rig, se3.inverse(rig.X_BL) @ X_BF @ X_FBoard)
    shots.write_poses(folder, {f"{number:02d}": X for number, X in enumerate(X_BF)})
    return folder


def test_a_folder_of_shots_becomes_a_rig_with_its_residuals_and_figures(
    rig, board_folder, tmp_path
):
    calibrate(board_folder, out=tmp_path, board=BOARD)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    found = StereoRig.load(tmp_path / "rig.yaml")
    assert metrics["calibration_reprojection_px"] < 0.15
    assert abs(found.baseline - rig.baseline) * 1e3 < 0.3
    expected = {
        "residuals.csv",
        "metrics.json",
        "left_camera_info.yaml",
        "right_camera_info.yaml",
        "corners.png",
        "residuals.png",
        "boards.png",
        "rectified.png",
    }
    assert expected <= {path.name for path in tmp_path.iterdir()}
    assert len((tmp_path / "residuals.csv").read_text().splitlines()) == 17


def test_a_folder_with_poses_becomes_the_cameras_place(rig, rig_file, flange_folder, tmp_path):
    handeye(flange_folder, rig=rig_file, out=tmp_path, board=BOARD)
    X_LL = se3.inverse(rig.X_BL) @ StereoRig.load(tmp_path / "rig.yaml").X_BL
    assert np.linalg.norm(X_LL[:3, 3]) * 1e3 < 0.5
    assert {"poses.png", "frames.png", "residuals.png", "covariance.json"} <= {
        path.name for path in tmp_path.iterdir()
    }
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["handeye_square_mm"] == pytest.approx(1e3 * BOARD.square, rel=1e-3)
    assert metrics["handeye_held_out_mm"] < 0.5
    assert "slack_sigmas" in (tmp_path / "residuals.csv").read_text().splitlines()[0]


def test_poses_survive_their_file(tmp_path):
    X_BF = flange_poses(make_rig(), X_FBoard, 3, np.random.default_rng(1))
    shots.write_poses(tmp_path, dict(zip("abc", X_BF, strict=True)))
    np.testing.assert_allclose(poses_table.read(tmp_path).X_BF, X_BF, atol=1e-9)


def test_cameras_on_the_flange_are_placed_in_it(rig, rig_file, flange_folder, tmp_path):
    """The same pictures, had the board stood still and the cameras been moved."""
    (tmp_path / "shots").mkdir()
    for path in flange_folder.glob("*.png"):
        (tmp_path / "shots" / path.name).symlink_to(path)
    stated = poses_table.read(flange_folder)
    X_FB = se3.inverse(stated.X_BF)
    shots.write_poses(tmp_path / "shots", dict(zip(stated.rows, X_FB, strict=True)))
    with pytest.raises(CalibrationError, match="--on-flange"):
        handeye(tmp_path / "shots", rig=rig_file, out=tmp_path, board=BOARD)
    out = tmp_path / "out"
    handeye(tmp_path / "shots", rig=rig_file, on_flange=True, out=out, board=BOARD)
    assert StereoRig.load(out / "rig.yaml").X_BL is None
    X_FL = np.array(json.loads((out / "on_flange.json").read_text())["X_FL"])
    assert np.linalg.norm((se3.inverse(rig.X_BL) @ X_FL)[:3, 3]) * 1e3 < 0.5


def test_missing_poses_and_missing_rows_are_named(rig, rig_file, board_folder, tmp_path):
    with pytest.raises(CalibrationError, match=r"no poses\.csv"):
        poses_table.read(board_folder)
    write_pictures(tmp_path, rig, poses_in_view(rig, 2, np.random.default_rng(0)))
    shots.write_poses(tmp_path, {"00": X_FBoard})
    with pytest.raises(CalibrationError, match="no row for 01"):
        handeye(tmp_path, rig=rig_file, out=tmp_path / "out", board=BOARD)


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="NAME_left"):
        shots.read_shots(tmp_path, BOARD)


def test_pictures_without_a_board_are_refused_and_nothing_is_written(tmp_path):
    black = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    shots.write_shot(tmp_path, "00", StereoPair(left=black, right=black, time=0.0))
    out = tmp_path / "out"
    with pytest.raises(CalibrationError, match="none of the 1 shots"):
        calibrate(tmp_path, out=out, board=BOARD)
    assert list(out.iterdir()) == []


def test_a_damaged_picture_is_named_and_one_without_its_partner_left_out(rig, tmp_path):
    write_pictures(tmp_path, rig, poses_in_view(rig, 2, np.random.default_rng(0)))
    (tmp_path / "00_right.png").unlink()
    found = shots.read_shots(tmp_path, BOARD)
    assert [shot.name for shot in found.shots] == ["01"]
    assert found.left_out == {"00_left.png": "no partner"}
    (tmp_path / "00_right.png").write_bytes(b"not a picture")
    with pytest.raises(PerceptionError, match="00_right"):
        shots.read_shots(tmp_path, BOARD)


def test_a_shot_that_was_copied_counts_once(rig, tmp_path):
    write_pictures(tmp_path, rig, poses_in_view(rig, 1, np.random.default_rng(0)))
    for side in ("left", "right"):
        content = (tmp_path / f"00_{side}.png").read_bytes()
        (tmp_path / f"copy_{side}.png").write_bytes(content)
    found = shots.read_shots(tmp_path, BOARD)
    assert [shot.name for shot in found.shots] == ["00"]
    assert found.left_out == {"copy": "the same as 00"}


def test_a_set_that_misses_its_limits_is_written_where_accepted_with_its_warnings(
    board_folder, tmp_path, capsys
):
    limits = QualityLimits(coverage=0.99)
    with pytest.raises(CalibrationError, match="99% are needed"):
        calibrate(board_folder, out=tmp_path, board=BOARD, limits=limits)
    calibrate(board_folder, out=tmp_path, board=BOARD, limits=limits, accept=True)
    assert "99% are needed" in (tmp_path / "rig.yaml").read_text().replace("\n", " ")
    assert StereoRig.load(tmp_path / "rig.yaml").baseline > 0.05
    assert "Accepted in spite of this" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", [".jpg", ".tiff", ".bmp"])
def test_pictures_of_any_kind_are_read(rig, tmp_path, suffix):
    write_pictures(tmp_path, rig, poses_in_view(rig, 1, np.random.default_rng(0)))
    from_png = shots.read_shots(tmp_path, BOARD).shots[0]
    for path in list(tmp_path.glob("*.png")):
        cv2.imwrite(str(path.with_suffix(suffix)), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        path.unlink()
    found = shots.read_shots(tmp_path, BOARD).shots[0]
    assert found.name == "00"
    assert np.abs(found.left - from_png.left).max() < 0.1


def test_pictures_of_another_size_are_named(rig, tmp_path):
    write_pictures(tmp_path, rig, poses_in_view(rig, 2, np.random.default_rng(0)))
    cv2.imwrite(str(tmp_path / "01_left.png"), np.zeros((100, 120), np.uint8))
    with pytest.raises(CalibrationError, match=r"01_left.*120x100"):
        shots.read_shots(tmp_path, BOARD)


def test_a_rig_of_another_resolution_is_refused(rig, flange_folder, tmp_path):
    replace(rig, left=replace(rig.left, width=1280, height=1024)).save(tmp_path / "larger.yaml")
    with pytest.raises(CalibrationError, match="1280x1024"):
        handeye(flange_folder, rig=tmp_path / "larger.yaml", out=tmp_path / "out", board=BOARD)


@pytest.mark.parametrize("command", [["calibrate"], ["handeye", "--rig", "rig.yaml"]])
@pytest.mark.parametrize("arguments", [[], ["folder", "--twin"]])
def test_the_command_takes_either_a_folder_or_the_twin(command, arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main([*command, *arguments])
    assert caught.value.code == 1
    assert "either a folder of shots or --twin" in capsys.readouterr().err
