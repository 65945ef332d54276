"""Two scans side by side: known differences are found, and folders that cannot be compared are
refused.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from breastscan.commands.compare import compare
from breastscan.errors import ConfigError
from tests.run.synthetic_run import synthetic_log

LATER = 0.4
DEEPER = 0.002
HARDER = 0.25
ROTATION = 0.01
"""What the second run does otherwise [s, m, N, rad]."""


@pytest.fixture(scope="module")
def log():
    return synthetic_log(np.random.default_rng(0))


@pytest.fixture
def run(tmp_path, log):
    """A function that writes a run folder."""

    def write(name, changed=None):
        folder = tmp_path / name
        folder.mkdir()
        (log if changed is None else changed).save(folder / "trajectory.parquet")
        return folder

    return write


def changed(log):
    """Deeper, harder, one joint rotated, and late from halfway round the loop on."""
    X_BP = log.X_BP.copy()
    X_BP[:, :3, 3] += DEEPER * np.nan_to_num(log.X_BP_plan[:, :3, 2])
    R = np.array(
        [
            [np.cos(ROTATION), -np.sin(ROTATION), 0],
            [np.sin(ROTATION), np.cos(ROTATION), 0],
            [0, 0, 1],
        ]
    )
    X_BP[:, :3, :3] = X_BP[:, :3, :3] @ R
    wrench_P, q, t = (values.copy() for values in (log.wrench_P, log.q, log.t))
    wrench_P[:, 2] -= HARDER
    q[:, 3] += ROTATION
    t[np.nan_to_num(log.s) > 0.2] += LATER
    force = log.true_force + HARDER
    return replace(log, t=t, q=q, X_BP=X_BP, wrench_P=wrench_P, true_force=force)


def test_a_run_does_not_differ_from_itself(run, tmp_path):
    folder = run("a")
    compare(folder, folder, tmp_path / "out")
    differences = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert len(differences) == 16
    assert all(entry["largest"] == pytest.approx(0.0, abs=1e-9) for entry in differences.values())


def test_each_difference_is_found_with_its_sign_and_unit(run, log, tmp_path):
    compare(run("a"), run("b", changed(log)), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["joint_4_deg"]["mean"] == pytest.approx(np.rad2deg(ROTATION))
    assert found["joint_3_deg"]["rms"] == pytest.approx(0.0, abs=1e-9)
    assert found["probe_turn_deg"]["rms"] == pytest.approx(np.rad2deg(ROTATION), rel=1e-3)
    assert found["tip_normal_mm"]["mean"] == pytest.approx(-1e3 * DEEPER, rel=1e-3)
    assert found["tip_across_mm"]["rms"] == pytest.approx(0.0, abs=1e-3)
    assert found["force_n"]["mean"] == pytest.approx(HARDER)
    assert found["true_force_n"]["mean"] == pytest.approx(HARDER)
    assert found["time_s"]["largest"] == pytest.approx(LATER)
    assert found["plan_mm"]["largest"] == pytest.approx(0.0, abs=1e-9)


def test_a_run_at_half_the_speed_is_compared_at_equal_path_length_not_at_equal_time(
    run, log, tmp_path
):
    slow = replace(log, t=2 * log.t)
    compare(run("a"), run("b", slow), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["tip_x_mm"]["rms"] == pytest.approx(0.0, abs=1e-9)
    loop = log.t[log.in_loop]
    assert found["time_s"]["largest"] == pytest.approx(loop[-1] - loop[0])


def test_a_pause_shows_in_the_timing_alone(run, log, tmp_path):
    """While it waits a scan stays at its path length, and the rows of the pause are no places of
    their own.
    """
    centre = int(np.flatnonzero(np.nan_to_num(log.s) > 0.1)[0])
    rows = np.arange(len(log.t))
    paused = log.take(np.r_[rows[:centre], np.full(500, centre), rows[centre:]])
    paused = replace(paused, t=paused.t + 1.0 * (np.arange(len(paused.t)) >= centre + 500))
    compare(run("a"), run("b", paused), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["tip_x_mm"]["rms"] == pytest.approx(0.0, abs=1e-2)
    assert found["time_s"]["largest"] == pytest.approx(1.0, abs=0.01)


def test_a_run_of_hardware_has_no_true_force(run, tmp_path):
    real = synthetic_log(np.random.default_rng(1), with_truth=False)
    compare(run("a"), run("b", real), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert "true_force_n" not in found
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "compare.json",
        "joints.png",
        "tip.png",
        "force.png",
    }


def test_a_folder_that_is_no_run_is_refused(run, tmp_path):
    with pytest.raises(ConfigError, match="is not a run"):
        compare(run("a"), tmp_path / "nowhere", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_scan_that_never_came_to_its_path_is_refused(run, tmp_path):
    early = synthetic_log(np.random.default_rng(0), with_loop=False)
    with pytest.raises(ConfigError, match="no loop"):
        compare(run("a"), run("b", early), tmp_path / "out")


def test_loops_over_different_parts_of_the_path_do_not_overlap(run, log, tmp_path):
    early, late = (log.take(np.flatnonzero(rows)) for rows in (log.s < 0.1, log.s > 0.2))
    with pytest.raises(
        ConfigError, match=r"do not overlap: their loops cover 0 \.\. 100 mm and 200 \.\. "
    ):
        compare(run("a", early), run("b", late), tmp_path / "out")


def test_scans_of_different_places_do_not_overlap(run, log, tmp_path):
    X_BP_plan = log.X_BP_plan.copy()
    X_BP_plan[:, 0, 3] += 0.2
    moved = replace(log, X_BP_plan=X_BP_plan)
    with pytest.raises(ConfigError, match="planned tips are 200 mm apart"):
        compare(run("a"), run("b", moved), tmp_path / "out")
