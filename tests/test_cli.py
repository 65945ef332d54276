"""What a user meets at the prompt: help, errors that help, exit status."""

import errno
import os
import platform
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

import pytest

from breastscan import cli
from breastscan.commands import doctor
from breastscan.commands.console import twin_imports
from breastscan.errors import PlanningError
from breastscan.run import provenance

FILE_COMMANDS = ("reconstruct", "calibrate", "rig", "handeye", "plan", "compare", "doctor")


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    captured = capsys.readouterr()
    return caught.value.code, captured.out, captured.err


def test_help_lists_every_command(capsys):
    status, out, _ = run(capsys, "--help")
    assert status == 0
    assert all(name in out for name in cli.COMMANDS)


def test_a_reader_that_has_seen_enough_ends_it_without_a_traceback():
    program = [sys.executable, "-m", "breastscan", "scan", "--help-all"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()
    assert process.returncode == 1


def test_no_command_prints_the_help_and_fails(capsys):
    status, out, _ = run(capsys)
    assert status == 2
    assert "usage" in out


def test_an_unknown_command_names_those_that_exist(capsys):
    status, _, err = run(capsys, "sacn")
    assert status == 1
    assert "sacn" in err
    assert "scan" in err


def test_an_expected_error_ends_in_one_line_and_status_one(capsys, monkeypatch):
    def fail() -> None:
        raise PlanningError("point 3 lies 40 mm out of reach: move the phantom closer", 3)

    monkeypatch.setattr(doctor, "doctor", fail)
    status, _, err = run(capsys, "doctor")
    assert status == 1
    assert err.strip() == "PlanningError: point 3 lies 40 mm out of reach: move the phantom closer"


def test_notes_on_an_error_are_told_below_it(capsys, monkeypatch):
    def fail() -> None:
        error = PlanningError("too far")
        error.add_note("In the twin, [link 4] touched the table")
        raise error

    monkeypatch.setattr(doctor, "doctor", fail)
    told = run(capsys, "doctor")[2].splitlines()
    assert told == ["PlanningError: too far", "In the twin, [link 4] touched the table"]


def test_brackets_in_an_error_are_told_as_they_are(capsys, monkeypatch):
    def fail() -> None:
        raise PlanningError("expected [m], got [/red]", 3)

    monkeypatch.setattr(doctor, "doctor", fail)
    assert run(capsys, "doctor")[2].strip() == "PlanningError: expected [m], got [/red]"


def test_a_full_disk_ends_in_one_line(capsys, monkeypatch):
    def fail() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "out/scan/left.png")

    monkeypatch.setattr(doctor, "doctor", fail)
    status, _, err = run(capsys, "doctor")
    assert status == 1
    assert err.startswith("No space left on device: free some, or choose another folder")
    assert len(err.strip().splitlines()) == 1


def test_the_first_line_of_any_failure_names_a_package_that_does_not_fit(capsys, monkeypatch):
    def fail() -> None:
        raise AttributeError("module 'cv2' has no attribute 'CALIB_HAND_EYE_PARK'")

    monkeypatch.setattr(doctor, "doctor", fail)
    monkeypatch.setattr(
        provenance,
        "version_of",
        lambda name: "5.0.0" if name == "opencv-python-headless" else version(name),
    )
    with pytest.raises(AttributeError):
        cli.main(["doctor"])
    err = capsys.readouterr().err
    assert err.startswith("opencv-python-headless is 5.0.0, needed is ")
    assert "<5" in err


def test_what_is_installed_here_fits():
    assert provenance.unsuited() == []


@pytest.mark.parametrize("depth", [1, 3])
def test_a_ctrl_c_that_falls_into_a_compiled_kernel_is_one_too(capsys, monkeypatch, depth):
    def interrupted() -> None:
        error: BaseException = KeyboardInterrupt()
        for _ in range(depth):
            chained = SystemError("a kernel returned a result with an exception set")
            chained.__cause__ = error
            error = chained
        raise error

    monkeypatch.setattr(doctor, "doctor", interrupted)
    status, _, err = run(capsys, "doctor")
    assert status == 130
    assert "Interrupted" in err


def test_a_kernel_that_breaks_by_itself_is_no_interrupt(monkeypatch):
    def broken() -> None:
        raise SystemError("a kernel returned a result with an exception set")

    monkeypatch.setattr(doctor, "doctor", broken)
    with pytest.raises(SystemError):
        cli.main(["doctor"])


def test_ctrl_c_ends_with_the_status_of_an_interrupt(capsys, monkeypatch):
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(doctor, "doctor", interrupted)
    status, _, err = run(capsys, "doctor")
    assert status == 130
    assert "Interrupted" in err


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_every_command_has_its_help(capsys, command):
    status, out, _ = run(capsys, command, "--help")
    assert status == 0
    assert f"breastscan {command}" in out


def test_a_wrong_option_is_refused_with_a_hint(capsys):
    status, _, err = run(capsys, "scan", "--sed", "3")
    assert status != 0
    assert "--seed" in err


def python(*arguments, **environment):
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("command", ["scan", "view", "twin", "study"])
def test_a_back_end_that_does_not_load_is_told_in_one_line(command):
    child = python("-m", "breastscan", command, "--help", MUJOCO_GL="nonsense")
    assert child.returncode == 1
    assert child.stderr.startswith("ConfigError: MuJoCo does not load with MUJOCO_GL=nonsense")


def test_an_error_of_another_import_is_not_told_as_mujocos():
    with pytest.raises(ImportError, match="no_such_module"), twin_imports():
        import no_such_module  # noqa: F401


def test_commands_on_files_do_not_load_mujoco():
    modules = ", ".join(f"breastscan.commands.{name}" for name in FILE_COMMANDS)
    child = python("-c", f"import sys, {modules}; sys.exit('mujoco' in sys.modules)")
    assert child.returncode == 0, child.stderr


def test_the_overview_and_doctor_load_neither_kernels_nor_pictures():
    """They must answer where these do not load."""
    heavy = {"breastscan.scan", "breastscan.report", "cv2", "matplotlib", "polars", "mujoco"}
    code = (
        f"import sys, breastscan.cli, breastscan.commands.doctor; print({heavy} & "
        "sys.modules.keys())"
    )
    child = python("-c", code)
    assert child.stdout.strip() == "set()", child.stdout + child.stderr


def test_the_version_is_told(capsys):
    cli.main(["--version"])
    assert capsys.readouterr().out.strip() == f"breastscan {version('breastscan')}"


def test_the_version_of_a_tree_that_is_not_installed_is_told_too(capsys, monkeypatch):
    def absent(package):
        raise PackageNotFoundError(package)

    monkeypatch.setattr(provenance, "version", absent)
    cli.main(["--version"])
    assert capsys.readouterr().out.strip() == "breastscan not installed"
    assert set(provenance.versions().values()) == {platform.python_version(), "not installed"}


def completed(script, *words):
    """What bash proposes for the last of some words."""
    line = " ".join(f"'{word}'" for word in words)
    asked = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _breastscan; echo ${{COMPREPLY[@]}}"
    child = subprocess.run(
        ["bash", "-c", f"{script}\n{asked}"], capture_output=True, text=True, check=True
    )
    return child.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_options_and_settings(capsys):
    cli.main(["--completion"])
    script = capsys.readouterr().out
    assert completed(script, "breastscan", "rec") == ["reconstruct"]
    assert completed(script, "breastscan", "scan", "--no-v") == ["--no-video"]
    assert completed(script, "breastscan", "scan", "--scene.phantom.br") == [
        "--scene.phantom.breast"
    ]
    assert completed(script, "breastscan", "scan", "--set", "scene.phantom.br") == [
        "scene.phantom.breast="
    ]
    assert completed(script, "breastscan", "reconstruct", "--scene") == []


def test_a_mistyped_command_or_study_is_told_with_the_nearest(capsys):
    assert "did you mean scan" in run(capsys, "scna")[2]
    assert "did you mean joints" in run(capsys, "study", "joint")[2]


@pytest.mark.parametrize(
    "arguments",
    [
        ("scan", "--seed", "-1"),
        ("scan", "--scene.phantom.seed", "-2"),
        ("scan", "--scene.phantom.texture_seed", "-2"),
        ("scan", "--perception.segment.seed", "-2"),
        ("view", "--web", "--seed", "-1"),
        ("calibrate", "--twin", "--seed", "-1"),
        ("study", "weights", "--seed", "-1"),
    ],
)
def test_a_negative_seed_is_refused_before_any_work(capsys, tmp_path, arguments):
    status, _, err = run(capsys, *arguments, "--out", str(tmp_path / "out"))
    assert status == 1
    assert "seed must be a whole number from 0 on" in err
    assert not (tmp_path / "out").exists()


def test_a_set_point_above_the_supervisors_limit_is_refused_before_any_work(capsys, tmp_path):
    options = ("--contact.force", "16", "--out", str(tmp_path / "out"))
    status, _, err = run(capsys, "scan", *options)
    assert status != 0
    assert "below safety.force" in err
    assert not (tmp_path / "out").exists()
