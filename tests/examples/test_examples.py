"""Every example runs as its reader would run it, and prints what it promises."""

import re
import runpy
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from breastscan.run.reading import Run
from tests.sim.controller.served import address, served

EXAMPLES = Path(__file__).parents[2] / "examples"
FIRST, ON_A_ROBOT = "scan_the_twin", "scan_with_a_robot"
OTHERS = {
    "calibrate_from_boards": r"18 of 18 shots, .* missed by 0\.0\d\d px",
    "disparity_of_a_pair": r"disparity \d+\.\d to \d+\.\d px",
    "feedrate_on_a_nurbs_path": r"fastest 25\.00 mm/s",
    "hold_still_while_it_breathes": r"one breath of 2 mm: 0\.\d\d to 1\.\d\d N",
    "inverse_kinematics": r"-100\. +110\. .* deg, off by \d\.\de-1\d mm",
    "loop_on_a_cloud": r"15 points at 2\d\.\d mm height",
    "own_force_law": r"force error 0\.[01]\d N RMS",
    "press_soft_and_stiff_breasts": r"15 kPa: 0\.\d\d N .*\n30 kPa: 1\.\d\d N",
    "program_for_a_controller": r"a program of \d+ lines",
    "read_a_log": r"along the loop -4\.\d\d mm over the plan",
    "step_the_twin_by_hand": r"0\.602 s: joint 6 turned by +9\.\d\d deg",
}
"""What each prints, among other things."""


def run(folder, name):
    """What an example that runs in a folder leaves in its variables, and what it prints."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        patch.chdir(folder)
        left = runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return left, printed.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder that all examples run in."""
    return tmp_path_factory.mktemp("examples")


@pytest.fixture(scope="module")
def first(folder):
    return run(folder, FIRST)


def test_the_first_example_scans_the_twin_and_holds_it_against_the_truth(first):
    left, printed = first
    result = left["result"]
    assert result.metrics["executed_truth_rms_mm"] < 1.5
    assert result.metrics["contact_fraction"] == 1.0
    assert result.images.left.shape == (1024, 1280)
    assert np.nanmax(result.trajectory.true_tilt) < np.deg2rad(10.0)
    assert "whole chain's error: 0." in printed


def test_it_leaves_a_whole_run_folder(first, folder):
    run_folder = folder / "out" / "scan"
    read = Run.load(run_folder)
    assert read.metrics == first[0]["result"].summary()
    assert read.config["scene"]["phantom"]["seed"] == read.config["seed"] == 0
    assert pl.read_parquet_metadata(run_folder / "trajectory.parquet")["seed"] == "0"
    assert (run_folder / "report.html").is_file()


def test_a_scan_that_touched_nothing_is_held_against_what_truth_there_is(first):
    twin, result = first[0]["twin"], first[0]["result"]
    in_air = result.trajectory.take(np.arange(100))
    measured = twin.measured(replace(result, trajectory=in_air, metrics={}))
    assert measured.metrics["surface_rmse_mm"] == result.metrics["surface_rmse_mm"]
    assert "force_rmse_n" not in measured.metrics
    assert not measured.trajectory.true_force.any()
    assert measured.trajectory.true_tilt is None


@pytest.mark.usefixtures("first")
@pytest.mark.parametrize("name", OTHERS)
def test_an_example_prints_what_it_shows(folder, name):
    assert re.search(OTHERS[name], run(folder, name)[1])


@pytest.mark.usefixtures("first")
def test_the_same_scan_with_a_robot_takes_another_robot_and_cell(folder):
    """In a process of its own: the link's starts from the file that was run."""
    host = address(46)
    with served(host):
        command = [sys.executable, str(EXAMPLES / f"{ON_A_ROBOT}.py"), host]
        child = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert re.search(r"1\d\d mm in the air, \d+\.\d s", child.stdout), child.stdout + child.stderr
    assert "touched: False" in child.stdout


def test_the_readme_shows_the_first_example():
    readme = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    shown = readme.split("```python\n")[1].split("```")[0]
    example = (EXAMPLES / f"{FIRST}.py").read_text(encoding="utf-8")
    assert set(shown.splitlines()) <= set(example.splitlines())


def test_every_example_is_run_and_says_what_it_shows():
    files = {path.stem: path.read_text(encoding="utf-8") for path in EXAMPLES.glob("*.py")}
    assert set(files) == {FIRST, ON_A_ROBOT, *OTHERS}
    assert all(text.startswith('"""') for text in files.values())
    assert all(len(text.splitlines()) <= 45 for text in files.values())
