"""The main job as a user runs it: one scan of the default phantom, held to what the README
claims.
"""

import errno
import functools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest
import tyro

from breastscan import cli
from breastscan.camera.interface import StereoCamera, StereoPair
from breastscan.commands import settings
from breastscan.commands.results import kept_elsewhere
from breastscan.commands.scan import scan
from breastscan.errors import CalibrationError, ConfigError, PerceptionError, PlanningError
from breastscan.geometry import kinematics
from breastscan.robot.interface import Robot
from breastscan.run.bars import SCAN, bars_of
from breastscan.run.trajectory import Trajectory
from breastscan.run.unfinished import ABORTED
from breastscan.scan import PerceptionConfig, ScanConfig, Stages, perceive
from breastscan.vision.camera import StereoRig
from sim.arm.servo import ServoConfig
from sim.cameras.camera import SimStereoCamera
from sim.robot import SimRobot
from sim.scene import Scene, SceneConfig
from sim.twin import Twin
from sim.wrist.probe import tip_pose
from sim.wrist.wrench_errors import WRENCH_CLASSES

FILES = {
    "metrics.json",
    "config.json",
    "left.png",
    "right.png",
    "disparity.png",
    "cloud.ply",
    "path.csv",
    "trajectory.parquet",
    "cell.json",
    "report.html",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("scan")
    scan(out, video=False)
    return out


@pytest.fixture(scope="module")
def metrics(folder):
    return json.loads((folder / "metrics.json").read_text())


@pytest.fixture(scope="module")
def trajectory(folder):
    return Trajectory.load(folder / "trajectory.parquet")


def test_the_folder_is_complete_and_holds_nothing_else(folder):
    assert {path.name for path in folder.iterdir()} == FILES


@pytest.mark.parametrize("bar", bars_of(SCAN).values(), ids=lambda bar: bar.key)
def test_every_bar_holds(metrics, bar):
    assert bar.holds(metrics[bar.key])


def test_the_probe_is_never_near_lifting_off_and_the_feed_is_steady(metrics):
    assert metrics["force_min_n"] > 2.5
    assert metrics["speed_fluctuation_pct"] <= 1e-6


def test_the_log_runs_at_500_hz_without_a_gap(trajectory):
    np.testing.assert_allclose(np.diff(trajectory.t), 0.002, atol=1e-9)


def test_joint_angles_in_the_log_are_the_running_arms_not_the_plans(trajectory):
    loop = trajectory.take(np.flatnonzero(trajectory.in_loop))
    late = round(ServoConfig().servo.lag / 0.002)
    assert np.abs(loop.q - loop.target).max() > 0.0
    # the arm trails its targets by the servo's lag
    assert np.abs(loop.q[late:] - loop.target[:-late]).max() < 0.001
    # the force controller moved the targets by the indentation
    assert np.abs(loop.target - loop.q_plan).max() > 0.005
    numeric = np.gradient(loop.q, 0.002, axis=0)
    assert np.abs(numeric - loop.qd)[2:-2].max() < 0.02


def test_the_loop_is_closed_and_lies_around_the_breast(trajectory):
    """And the reference goes where pressing drags the skin, a millimetre beside it."""
    loop = trajectory.in_loop
    tip = (kinematics.forward(trajectory.q_plan[loop]) @ tip_pose(np.pi / 4))[:, :3, 3]
    np.testing.assert_allclose(tip[0], tip[-1], atol=1e-6)
    beside = np.linalg.norm(trajectory.X_BP_plan[loop, :3, 3] - tip, axis=1)
    assert 0.5e-3 < np.median(beside) < beside.max() < 2e-3
    assert 0.3 < trajectory.s[trajectory.in_loop][-1] < 0.5
    assert np.ptp(tip[:, 2]) < 1e-3


def test_true_and_measured_force_agree_within_the_sensors_gain_and_noise(trajectory):
    loop = trajectory.take(np.flatnonzero(trajectory.in_loop))
    error = loop.pressing_force - loop.true_force
    sensor = WRENCH_CLASSES["industrial"]
    drifted = sensor.drift * (loop.t[-1] - trajectory.t[0])
    assert abs(error.mean()) < 2 * sensor.gain_error * 5.0 + drifted
    assert error.std() < 0.08


def test_the_settings_of_a_run_are_written_with_its_seed_and_where_it_came_from(folder):
    config = json.loads((folder / "config.json").read_text())
    assert config["seed"] == 0
    assert config["contact"]["force"] == 5.0
    assert "mujoco" in config["versions"]
    assert {"date", "command", "commit"} <= set(config)


def test_the_settings_of_a_run_are_those_of_a_scan_that_is_given_its_config(folder, tmp_path):
    """What `--config` gives is what made the run, and what was left unset is still unset."""

    @functools.wraps(scan)
    def taken(**given):
        return given

    arguments = ["--config", str(folder / "config.json"), "--out", str(tmp_path)]
    options, unused = settings.expanded(scan, arguments)
    given = tyro.cli(taken, args=options)
    assert unused == []
    assert given["config"] == ScanConfig()
    assert given["scene"] == SceneConfig()
    assert (given["seed"], given["video"], given["rig"]) == (0, False, None)


def test_what_was_measured_is_kept_elsewhere_when_its_folder_cannot_be_written(
    tmp_path, monkeypatch
):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.setattr(tempfile, "mkdtemp", lambda **_: str(elsewhere))

    def save(place):
        (place / "trajectory.parquet").write_text("all of it")

    with (
        pytest.raises(ConfigError, match=r"No space left on device\): what was measured is in"),
        kept_elsewhere(tmp_path / "out", save),
    ):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert (elsewhere / "trajectory.parquet").read_text() == "all of it"


def test_the_twin_keeps_the_protocols():
    scene = Scene(SceneConfig())
    assert isinstance(SimRobot(scene), Robot)
    assert isinstance(SimStereoCamera(scene), StereoCamera)


@pytest.fixture(scope="module")
def rig():
    return Scene(SceneConfig()).rig


def test_images_of_different_sizes_are_refused(rig):
    pair = StereoPair(
        left=np.zeros((1024, 1280), np.uint8), right=np.zeros((960, 1280), np.uint8), time=0.0
    )
    with pytest.raises(PerceptionError, match="1280x960"):
        perceive(pair, rig, PerceptionConfig(), Stages())


def test_an_image_without_a_breast_is_refused(rig):
    noise = np.random.default_rng(0).integers(100, 140, (1024, 1280), dtype=np.uint8)
    pair = StereoPair(left=noise, right=np.roll(noise, -120, axis=1), time=0.0)
    with pytest.raises(PerceptionError, match="expected a breast"):
        perceive(pair, rig, PerceptionConfig(), Stages())


@pytest.mark.parametrize(
    ("scene", "error"),
    [
        (lambda tmp: SceneConfig(p_BS=(0.62, 0.0, 0.20), mount_angle=0.0), PlanningError),
        (lambda tmp: SceneConfig(rig=tmp / "missing.yaml"), CalibrationError),
    ],
)
def test_a_scan_that_cannot_be_made_leaves_earlier_results_whole(tmp_path, scene, error):
    (tmp_path / "metrics.json").write_text("earlier")
    with pytest.raises(error):
        scan(tmp_path, video=False, scene=scene(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]
    assert (tmp_path / "metrics.json").read_text() == "earlier"


def test_what_else_touched_than_the_face_is_told_behind_an_error(tmp_path, capsys, monkeypatch):
    """The controller can only wonder at its force; what the arm met, the twin knows."""
    note = "In the twin, the probe's body touched the chest plate, first at 3.1 s"
    monkeypatch.setattr(Twin, "touched_else", note)
    with pytest.raises(SystemExit):
        cli.main(["scan", "--set", "safety.force=5.02", "--no-video", "--out", str(tmp_path)])
    told = capsys.readouterr().err
    abort = json.loads((tmp_path / ABORTED / "abort.json").read_text())
    assert abort["notes"] == [note]
    assert f"{abort['message']}\n{note}" in told


def test_a_file_that_is_not_a_rig_is_named(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("not a rig")
    with pytest.raises(CalibrationError, match=r"rig\.yaml is not a rig file"):
        StereoRig.load(path)


def test_ctrl_c_ends_the_program_with_status_130_and_leaves_nothing_half_done(tmp_path, folder):
    command = [sys.executable, "-m", "breastscan", "scan", "--no-video", "--out", str(tmp_path)]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while not any(tmp_path.iterdir()):  # the staging folder appears when the scan starts
        time.sleep(0.2)
    time.sleep(2.0)
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=60)
    assert child.returncode == 130, errors
    assert list(tmp_path.iterdir()) == []
