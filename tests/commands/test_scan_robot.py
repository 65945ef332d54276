"""What a scan with a robot refuses before anything moves."""

from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from breastscan.commands import results
from breastscan.commands import scan as scan_command
from breastscan.commands.scan import host_of, robot_cell, scan
from breastscan.control.safety import SafetyLimits
from breastscan.errors import CalibrationError, ConfigError, RobotError, SafetyError
from breastscan.geometry import calibration_file
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.robot.payload import Payload
from breastscan.robot.ur.worker import LinkLimits
from breastscan.scan import ScanConfig
from sim.room.cell import cell_of
from sim.scene import Scene
from tests.sim.controller.served import address

NOBODY = f"rtde://{address(92)}"


@pytest.fixture(autouse=True)
def nothing_may_be_looked_at(monkeypatch):
    def refuse(*_):
        raise AssertionError("nothing may be looked at")

    monkeypatch.setattr(scan_command, "open_camera", refuse)
    monkeypatch.setattr(scan_command, "SimStereoCamera", refuse)


@pytest.mark.parametrize(
    ("option", "host"), [("rtde://127.0.0.1", "127.0.0.1"), ("rtde://arm.cell", "arm.cell")]
)
def test_the_host_stands_after_the_scheme(option, host):
    assert host_of(option) == host


@pytest.mark.parametrize(
    "option", ["127.0.0.1", "rtde://", "rtde://arm:30004", "http://arm", "rtde://arm/x"]
)
def test_a_robot_of_another_form_is_refused(option):
    with pytest.raises(ConfigError, match="rtde://HOST"):
        host_of(option)


@pytest.mark.parametrize(
    "options",
    [
        {"yes": True},
        {"dry_run": True},
        {"camera": "devices:0,1"},
        {"cell": "cell.json"},
        {"link": LinkLimits(slack=2.0)},
    ],
)
def test_what_only_a_robot_has_is_refused_without_one(tmp_path, options):
    with pytest.raises(ConfigError, match="--robot"):
        scan(tmp_path / "out", **options)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"fine": True, "video": False}, "--fine"),
        ({"fine": True, "robot": NOBODY}, "--fine"),
        ({"seed": 3, "robot": NOBODY, "cell": Path("c"), "camera": "folder:d"}, "--seed and scene"),
    ],
)
def test_what_would_be_ignored_is_refused(tmp_path, options, why):
    with pytest.raises(ConfigError, match=why):
        scan(tmp_path / "out", **options)


def test_a_rig_without_hand_eye_is_refused_first(tmp_path):
    replace(Scene().rig, X_BL=None).save(tmp_path / "rig.yaml")
    with pytest.raises(CalibrationError, match="handeye"):
        scan(tmp_path / "out", robot=NOBODY, rig=tmp_path / "rig.yaml", yes=True)


@dataclass
class Result:
    """What a scan gives, kept."""

    config: ScanConfig
    kept: dict

    def save(self, folder, **settings):
        self.kept.update(settings, safety=self.config.safety)


@pytest.fixture
def kept(monkeypatch):
    """What a scan is given and leaves, on a robot that is not there."""
    kept = {}

    def run_scan(robot, camera, cell, config, **_):
        kept.update(taken=cell)
        return Result(config, kept)

    for name in ("SimStereoCamera", "summarise", "_introduction"):
        monkeypatch.setattr(scan_command, name, lambda *_, **__: "")
    monkeypatch.setattr(scan_command.preflight, "examine", lambda *_: None)
    monkeypatch.setattr(scan_command.preflight, "opened", lambda link: nullcontext())
    monkeypatch.setattr(results.report, "write", lambda folder: None)
    monkeypatch.setattr(scan_command, "run_scan", run_scan)
    return kept


def test_what_is_kept_of_a_scan_is_as_it_was_set_and_the_link_as_it_was(tmp_path, kept):
    scan(tmp_path / "out", robot=NOBODY, yes=True, link=LinkLimits(slack=3.0))
    assert kept["taken"].link == kept["link"] == LinkLimits(slack=3.0)
    assert kept["safety"] == SafetyLimits()


@pytest.mark.parametrize("typed", ["yes", "", "Contact", "contact me"])
def test_another_word_than_the_one_asked_for_is_no_consent(tmp_path, kept, monkeypatch, typed):
    asked = []
    monkeypatch.setattr(scan_command.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(
        scan_command.console, "input", lambda question: asked.append(question) or typed
    )
    with pytest.raises(SafetyError, match=f"'contact' was expected, '{typed}' was typed"):
        scan(tmp_path / "out", robot=NOBODY)
    assert "will touch" in asked[0]
    assert "'contact'" in asked[0]
    assert not (tmp_path / "out").exists()
    assert not kept


def test_the_word_asked_for_is_consent_and_a_dry_run_or_yes_asks_nothing(
    tmp_path, kept, monkeypatch
):
    monkeypatch.setattr(scan_command.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(scan_command.console, "input", lambda question: " contact\n")
    scan(tmp_path / "out", robot=NOBODY)
    assert kept.pop("taken")

    def asked(question):
        raise AssertionError(question)

    monkeypatch.setattr(scan_command.console, "input", asked)
    scan(tmp_path / "out", robot=NOBODY, dry_run=True)
    assert kept.pop("taken")
    scan(tmp_path / "out", robot=NOBODY, yes=True)
    assert kept.pop("taken")


def test_a_terminal_that_closes_at_the_question_is_no_consent(tmp_path, kept, monkeypatch):
    def closed(question):
        raise EOFError

    monkeypatch.setattr(scan_command.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(scan_command.console, "input", closed)
    with pytest.raises(SafetyError, match="nothing was touched"):
        scan(tmp_path / "out", robot=NOBODY)
    assert not kept


def test_the_calibration_of_an_arm_reaches_the_link(tmp_path, kept, monkeypatch):
    links = []
    monkeypatch.setattr(
        scan_command.preflight, "opened", lambda link: links.append(link) or nullcontext()
    )
    rows = [f"delta_{name} = [1e-3, 0, 0, 0, 0, 0]" for name in ("theta", "d", "a", "alpha")]
    (tmp_path / "calibration.conf").write_text("\n".join(["[mounting]", *rows]))
    file = tmp_path / "calibration.conf"
    scan(tmp_path / "out", robot=NOBODY, yes=True, calibration=file)
    np.testing.assert_array_equal(
        links[0].kinematics.X_joints, calibration_file.load(file).X_joints
    )
    assert kept["calibration"] == file


def test_nobody_to_agree_is_a_refusal(tmp_path):
    with pytest.raises(SafetyError, match="--yes"):
        scan(tmp_path / "out", robot=NOBODY)


def test_no_controller_is_told_and_leaves_nothing_behind(tmp_path):
    with pytest.raises(RobotError, match="no controller answers"):
        scan(tmp_path / "out", robot=NOBODY, yes=True)
    assert not (tmp_path / "out").exists()


def test_the_file_of_a_cell_takes_the_place_of_the_scenes_and_options_that_of_the_file(tmp_path):
    scene = Scene()
    other = replace(
        cell_of(scene),
        payload=Payload(mass=1.1, centre_F=scene.X_FP[:3, 3]),
        link=LinkLimits(slack=2.0),
    )
    other.save(tmp_path / "cell.json")
    assert robot_cell(scene, None, None, None, LinkLimits()).payload.mass < 0.5
    cell = robot_cell(scene, tmp_path / "cell.json", None, None, LinkLimits())
    assert (cell.payload.mass, cell.link.slack) == (1.1, 2.0)
    assert (
        robot_cell(scene, tmp_path / "cell.json", None, None, LinkLimits(slack=3.0)).link.slack
        == 3.0
    )


def test_rig_and_calibration_take_the_place_of_the_cells(tmp_path):
    scene = Scene()
    estimated = replace(scene.rig, X_BL=scene.X_BL @ scene.X_BL)
    estimated.save(tmp_path / "rig.yaml")
    rows = "\n".join(
        f"delta_{name} = [0.0002, 0, 0, 0, 0, 0]" for name in ("theta", "d", "a", "alpha")
    )
    (tmp_path / "calibration.conf").write_text(f"[mounting]\n{rows}\n")
    cell = robot_cell(
        scene, None, tmp_path / "rig.yaml", tmp_path / "calibration.conf", LinkLimits()
    )
    np.testing.assert_allclose(cell.rig.X_BL, estimated.X_BL, atol=1e-12)
    assert not np.array_equal(cell.kinematics.X_joints, KinematicCalibration.nominal().X_joints)
