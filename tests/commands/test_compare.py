"""Two scans side by side: known differences are found, and folders that cannot be compared are
refused.
"""

import json

import numpy as np
import polars as pl
import pytest

from breastscan.commands.compare import compare
from breastscan.errors import ConfigError
from tests.run.synthetic_run import trajectory_table

LATER = 0.4
DEEPER = 0.002
HARDER = 0.25
ROTATION = 0.01
"""What the second run does otherwise [s, m, N, rad]."""


@pytest.fixture(scope="module")
def table():
    return trajectory_table(np.random.default_rng(0))


@pytest.fixture
def run(tmp_path, table):
    """A function that writes a run folder."""

    def write(name, changed=None):
        folder = tmp_path / name
        folder.mkdir()
        (table if changed is None else changed).write_parquet(folder / "trajectory.parquet")
        return folder

    return write


def changed(table):
    """Deeper, harder, one joint rotated, and late from halfway round the loop on."""
    X_BP = table["X_BP"].to_numpy().reshape(-1, 4, 4).copy()
    X_BP[:, :3, 3] += DEEPER * np.nan_to_num(
        table["X_BP_plan"].to_numpy().reshape(-1, 4, 4)[:, :3, 2]
    )
    R = np.array(
        [
            [np.cos(ROTATION), -np.sin(ROTATION), 0],
            [np.sin(ROTATION), np.cos(ROTATION), 0],
            [0, 0, 1],
        ]
    )
    X_BP[:, :3, :3] = X_BP[:, :3, :3] @ R
    wrench, q = table["wrench"].to_numpy().copy(), table["q"].to_numpy().copy()
    wrench[:, 2] -= HARDER
    q[:, 3] += ROTATION
    t = table["t"].to_numpy().copy()
    t[np.nan_to_num(table["s"].to_numpy()) > 0.2] += LATER
    return table.with_columns(
        t=pl.Series(t), q=pl.Series(q, dtype=pl.Array(pl.Float64, 6)),
        X_BP=pl.Series(X_BP.reshape(-1, 16), dtype=pl.Array(pl.Float64, 16)),
        wrench=pl.Series(wrench, dtype=pl.Array(pl.Float64, 6)),
        true_force=table["true_force"] + HARDER,
    )  # fmt: skip


def test_a_run_does_not_differ_from_itself(run, tmp_path):
    folder = run("a")
    compare(folder, folder, tmp_path / "out")
    differences = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert len(differences) == 16
    assert all(entry["largest"] == pytest.approx(0.0, abs=1e-9) for entry in differences.values())


def test_each_difference_is_found_with_its_sign_and_unit(run, table, tmp_path):
    compare(run("a"), run("b", changed(table)), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["joint_3_deg"]["mean"] == pytest.approx(np.rad2deg(ROTATION))
    assert found["joint_2_deg"]["rms"] == pytest.approx(0.0, abs=1e-9)
    assert found["probe_turn_deg"]["rms"] == pytest.approx(np.rad2deg(ROTATION), rel=1e-3)
    assert found["tip_normal_mm"]["mean"] == pytest.approx(-1e3 * DEEPER, rel=1e-3)
    assert found["tip_across_mm"]["rms"] == pytest.approx(0.0, abs=1e-3)
    assert found["force_n"]["mean"] == pytest.approx(HARDER)
    assert found["true_force_n"]["mean"] == pytest.approx(HARDER)
    assert found["time_s"]["largest"] == pytest.approx(LATER)
    assert found["plan_mm"]["largest"] == pytest.approx(0.0, abs=1e-9)


def test_a_run_at_half_the_speed_is_compared_at_equal_path_length_not_at_equal_time(
    run, table, tmp_path
):
    slow = table.with_columns(t=2 * table["t"])
    compare(run("a"), run("b", slow), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["tip_x_mm"]["rms"] == pytest.approx(0.0, abs=1e-9)
    loop = table.filter(table["phase"] == "loop")["t"]
    assert found["time_s"]["largest"] == pytest.approx(loop[-1] - loop[0])


def test_a_pause_shows_in_the_timing_alone(run, table, tmp_path):
    """While it waits a scan stays at its path length, and the rows of the pause are no places of
    their own.
    """
    centre = int(np.flatnonzero(np.nan_to_num(table["s"].to_numpy()) > 0.1)[0])
    wait = pl.concat([table[centre : centre + 1]] * 500)
    rest = table[centre:].with_columns(t=table["t"][centre:] + 1.0)
    paused = pl.concat([table[:centre], wait, rest])
    compare(run("a"), run("b", paused), tmp_path / "out")
    found = json.loads((tmp_path / "out/compare.json").read_text())["differences"]
    assert found["tip_x_mm"]["rms"] == pytest.approx(0.0, abs=1e-2)
    assert found["time_s"]["largest"] == pytest.approx(1.0, abs=0.01)


def test_a_run_of_hardware_has_no_true_force(run, tmp_path):
    real = trajectory_table(np.random.default_rng(1), with_truth=False)
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
    early = trajectory_table(np.random.default_rng(0), with_loop=False)
    with pytest.raises(ConfigError, match="no loop"):
        compare(run("a"), run("b", early), tmp_path / "out")


def test_loops_over_different_parts_of_the_path_do_not_overlap(run, table, tmp_path):
    s = pl.col("s")
    with pytest.raises(
        ConfigError, match=r"do not overlap: their loops cover 0 \.\. 100 mm and 200 \.\. "
    ):
        compare(run("a", table.filter(s < 0.1)), run("b", table.filter(s > 0.2)), tmp_path / "out")


def test_scans_of_different_places_do_not_overlap(run, table, tmp_path):
    plan = table["X_BP_plan"].to_numpy().copy()
    plan[:, 3] += 0.2
    moved = table.with_columns(X_BP_plan=pl.Series(plan, dtype=pl.Array(pl.Float64, 16)))
    with pytest.raises(ConfigError, match="planned tips are 200 mm apart"):
        compare(run("a"), run("b", moved), tmp_path / "out")
