"""A scan that was cut off goes on where it ended, and leaves one log."""

import json
import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest

from breastscan import cli
from breastscan.commands.scan import _recall_truth
from breastscan.errors import ConfigError
from breastscan.run import journal
from breastscan.run.trajectory import OVERLAP, RESUME, Sample, Trajectory
from breastscan.run.unfinished import ABORTED, settings_file
from breastscan.scan import CutOff
from breastscan.scan_log import OVERLAP_LENGTH
from sim import PhantomConfig, SceneConfig, Twin
from sim.controller.fault_injection import TwinControl
from sim.robot import SimRobot
from sim.truth_log import TruthRecorder
from tests.sim.controller.served import ROOT, address, ask_dashboard, pass_time, served

HOST = address(49)
SHORT_LOOP = ("--planning.pattern.height-fraction", "0.85")
PERIOD = 0.002
STEP = 0.025 * PERIOD
"""Of the probe in a period [m]."""
SETTLED = 1.2
"""After first contact, until the probe is on the path [s]."""


def scan(*options):
    cli.main(["scan", *map(str, options)])


def refused(capsys, *options):
    """What is said of options that are not taken."""
    with pytest.raises(SystemExit) as ended:
        scan(*options)
    assert ended.value.code == 1
    return " ".join(capsys.readouterr().err.split())


def require_whole(out, resumptions):
    """The loop, each place once, without a gap; the force near its set-point; no scraps."""
    log = Trajectory.load(out / "trajectory.parquet")
    s = log.s[log.in_loop]
    assert s[0] < STEP
    assert (np.diff(s) > 0.0).all()
    assert np.diff(s).max() < 2.0 * STEP
    resumed = [row for row, phase in enumerate(log.phase) if phase == RESUME]
    assert len(resumed) == resumptions
    assert (np.diff(log.t) > 0.0).all()
    for row in resumed:
        reached = np.nanmax(log.s[:row])
        assert log.s[row] == pytest.approx(max(reached - OVERLAP_LENGTH, 0.0), abs=2 * STEP)
        again = [k for k in range(row, len(log.t)) if log.phase[k] == OVERLAP][:1]
        assert log.s[again] == pytest.approx(log.s[row], abs=2 * STEP)
    force = log.pressing_force[log.in_loop]
    assert 2.5 < force.min() < force.max() < 8.0
    assert log.contact[log.in_loop].all()
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["tracking_tangential_rmse_mm"] < 0.6
    assert metrics["scan_time_s"] > s[-1] / 0.025
    assert not (out / ABORTED).exists()
    assert not list(out.glob(".*"))
    return metrics


class Interrupted:
    """Presses Ctrl-C once, so many periods after the probe first touches."""

    def __init__(self, periods):
        self.left = periods
        self.send = SimRobot.servo_joint

    def __call__(self, robot, q):
        self.send(robot, q)
        if robot.contact is not None and robot.contact.depth > 0.0:
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt


@pytest.fixture(scope="module")
def cut_off(tmp_path_factory):
    """A scan in process, cut off on the loop."""
    out = tmp_path_factory.mktemp("resume") / "out"
    interrupted = Interrupted(round((SETTLED + 2.0) / PERIOD))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SimRobot, "servo_joint", lambda robot, q: interrupted(robot, q))
        with pytest.raises(SystemExit):
            scan("--no-video", "--out", out, *SHORT_LOOP)
    return out


def test_other_settings_than_its_own_are_refused_by_name(cut_off, capsys):
    given = ("--resume", cut_off, "--contact.force", "4.0", "--planning.pattern.points", "20")
    said = refused(capsys, *given)
    assert "contact.force was 5.0, is 4.0" in said
    assert "planning.pattern.points was 15, is 20" in said
    assert "video was False, is True" in refused(capsys, "--resume", cut_off, "--video")
    assert "leave out --out" in refused(capsys, "--resume", cut_off, "--out", cut_off / "other")
    given = ("--resume", cut_off, "--robot", f"rtde://{HOST}")
    assert "robot was None, is rtde://" in refused(capsys, *given)


def test_a_scan_in_process_goes_on_with_its_truth(cut_off, capsys):
    done = journal.read(cut_off / ABORTED / "journal.bin")
    told = json.loads((cut_off / ABORTED / "abort.json").read_text())
    assert told["error"] == "KeyboardInterrupt"
    assert told["path_reached_m"] > 0.02
    config = cut_off / ABORTED / "config.json"
    begun = json.loads(config.read_text())
    config.write_text(json.dumps({**begun, "commit": "0" * 40}))
    scan("--resume", cut_off)
    assert "was begun by commit 000000" in " ".join(capsys.readouterr().out.split())
    metrics = require_whole(cut_off, resumptions=1)
    assert metrics["contact_fraction"] == 1.0
    assert metrics["force_rmse_n"] < 0.5
    assert metrics["executed_truth_rms_mm"] < 1.5
    log = Trajectory.load(cut_off / "trajectory.parquet")
    np.testing.assert_array_equal(log.t[: len(done)], [sample.time for sample in done])
    assert "nothing to resume: the scan in" in refused(capsys, "--resume", cut_off)
    assert json.loads((cut_off / "config.json").read_text())["planning"] == begun["planning"]


def test_the_truth_of_a_version_that_kept_less_is_none(tmp_path, capsys):
    """The scan goes on, and says that nothing is measured against the truth."""
    sample = Sample(1.0, "loop", 0.0, *[np.zeros(6)] * 4, True)
    whole = TruthRecorder()
    whole.add(1.0, np.zeros(6), np.zeros(3), 0.0, np.eye(4), 0.0)
    kept = vars(whole.log())
    cut_off = CutOff(log=[sample], q=np.zeros((1, 6)), q_home=np.zeros(6))
    twin = Twin(SceneConfig(phantom=PhantomConfig(mechanics="printed")))
    np.savez(tmp_path / "truth.npz", **{name: kept[name] for name in kept if name != "rise"})
    assert not _recall_truth(twin, tmp_path / "truth.npz", cut_off)
    assert "less than this version keeps" in " ".join(capsys.readouterr().out.split())
    np.savez(tmp_path / "truth.npz", **kept)
    assert _recall_truth(twin, tmp_path / "truth.npz", cut_off)
    assert twin.robot.state().time == pytest.approx(1.0 + PERIOD)


def test_a_folder_in_which_nothing_was_cut_off_is_told(tmp_path):
    with pytest.raises(ConfigError, match="no scan was cut off"):
        settings_file(tmp_path)
    (tmp_path / ABORTED).mkdir()
    with pytest.raises(ConfigError, match="scan again"):
        settings_file(tmp_path)


def run_until(twin, in_contact, *options):
    """A scan in a program of its own, until it has pressed for so long [s]."""
    command = [sys.executable, "-m", "breastscan", "scan", *map(str, options)]
    child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    for pressing in (False, True):  # it may have been left in contact
        while (twin.do("status")["force"] > 3.0) is not pressing:
            assert child.poll() is None, child.communicate()[0].decode()
            time.sleep(0.02)
    pass_time(twin, in_contact)
    return child


def test_a_robots_scan_goes_on_after_a_kill_a_protective_stop_and_a_power_off(tmp_path):
    """One scan, cut off three times; the arm stays where it pressed, but for the last time."""
    out = tmp_path / "out"
    begin = ("--robot", f"rtde://{HOST}", "--yes", "--out", out, *SHORT_LOOP)
    resume = ("--resume", out, "--yes")
    with served(HOST) as process, closing(TwinControl(HOST)) as twin:
        child = run_until(twin, SETTLED + 1.6, *begin)
        child.kill()
        child.wait()
        assert not (out / ABORTED / "abort.json").exists()
        assert len(journal.read(out / ABORTED / "journal.bin")) * PERIOD > 2.0
        pass_time(twin, 0.2)
        assert twin.do("status")["force"] > 1.0  # it presses still

        child = run_until(twin, SETTLED + 2.2, *resume)
        twin.do("protective_stop")
        said = child.communicate(timeout=60)[0].decode()
        assert child.returncode == 1
        assert "protective stop" in said
        pass_time(twin, 5.5)
        ask_dashboard(HOST, "unlock protective stop")

        child = run_until(twin, SETTLED + 2.0, *resume)
        assert twin.do("status")["highest_force"] < 15.0
        process.kill()
        assert b"--resume" in child.communicate(timeout=60)[0]
        assert child.returncode == 1
    with served(HOST), closing(TwinControl(HOST)) as twin:
        scan(*resume)
        assert twin.do("status")["highest_force"] < 15.0
    require_whole(out, resumptions=3)


def test_a_link_that_dies_in_contact_is_told_and_the_scan_goes_on(tmp_path):
    out = tmp_path / "out"
    with served(HOST), closing(TwinControl(HOST)) as twin:
        begin = ("--robot", f"rtde://{HOST}", "--yes", "--out", out, *SHORT_LOOP)
        child = run_until(twin, SETTLED + 0.5, *begin)
        twin.do("close_connections")
        said = " ".join(child.communicate(timeout=120)[0].decode().split())
        assert child.returncode == 1
        assert "connection" in said
        assert f"To go on from there: breastscan scan --resume {out}" in said
        told = json.loads((out / ABORTED / "abort.json").read_text())
        assert told["error"] == "RobotError"
        assert told["path_reached_m"] > 0.0
        pass_time(twin, 0.5)
        assert np.abs(twin.do("status")["qd"]).max() < 1e-3  # it holds still
        child = run_until(twin, SETTLED, "--resume", out, "--yes")
        child.kill()
        child.wait()
    done = [sample.phase for sample in journal.read(out / ABORTED / "journal.bin")]
    assert RESUME in done
