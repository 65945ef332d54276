"""The run folder is complete or untouched, and everything in it is read back by other software."""

import json
import os
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import trimesh

from breastscan.errors import ConfigError, SafetyError
from breastscan.run import parquet, writing
from breastscan.run.columns import TRUTH
from breastscan.run.reading import OPTIONAL_FILES
from breastscan.run.trajectory import LOG_FILE, Trajectory
from tests.run.synthetic_run import synthetic_log


def test_results_replace_earlier_ones_only_when_the_block_ends_well(tmp_path):
    out = tmp_path / "run"
    with writing.staged(out) as folder:
        (folder / "metrics.json").write_text("first")
    with pytest.raises(RuntimeError), writing.staged(out) as folder:
        (folder / "metrics.json").write_text("half")
        raise RuntimeError
    assert (out / "metrics.json").read_text() == "first"
    assert [path.name for path in out.iterdir()] == ["metrics.json"]


def test_an_earlier_runs_film_does_not_stay_beside_a_run_without_one(tmp_path):
    for name in ("scan.mp4", "coverage.ply", "mine.txt"):
        (tmp_path / name).write_text("earlier")
    with writing.staged(tmp_path, OPTIONAL_FILES) as folder:
        (folder / "coverage.ply").write_text("new")
        assert (tmp_path / "scan.mp4").exists()
    left = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert left == {"coverage.ply": "new", "mine.txt": "earlier"}


def test_an_interrupt_leaves_no_scrap(tmp_path):
    with pytest.raises(KeyboardInterrupt), writing.staged(tmp_path) as folder:
        (folder / "left.png").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_an_output_folder_that_is_a_file_is_refused_before_any_work(tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ConfigError, match="--out"), writing.staged(tmp_path / "taken"):
        pytest.fail("the work must not start")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_output_folder_is_refused(tmp_path):
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(ConfigError, match="--out"), writing.staged(tmp_path / "run"):
        pytest.fail("the work must not start")


def test_json_is_strict_and_takes_arrays(tmp_path):
    writing.write_json(
        tmp_path / "m.json", {"a": np.arange(3.0), "b": np.float32(1.5), "c": tmp_path}
    )
    assert json.loads((tmp_path / "m.json").read_text())["a"] == [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="JSON"):
        writing.write_json(tmp_path / "m.json", {"a": float("nan")})


def test_settings_that_json_cannot_hold_are_refused_before_any_work():
    writing.require_writable({"a": np.arange(2.0), "b": None})
    for wrong in (float("inf"), object()):
        with pytest.raises(ConfigError, match=r"cannot be written to config\.json"):
            writing.require_writable({"a": wrong})


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_table_on_a_full_disk_is_an_error_that_says_so():
    with pytest.raises(OSError, match="No space left"):
        writing.write_csv(Path("/dev/full"), pl.DataFrame({"a": [1.0] * 9999}))
    with pytest.raises(OSError, match="No space left"):
        log = {name: np.zeros((9, len(group))) for name, group in TRUTH.items() if name == "q"}
        parquet.write(Path("/dev/full"), {"q": TRUTH["q"]}, log)


def test_the_cloud_is_read_back_with_points_and_normals(tmp_path):
    rng = np.random.default_rng(0)
    points, normals = rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    writing.write_cloud(tmp_path / "cloud.ply", points, normals)
    cloud = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_allclose(cloud.vertices, points, atol=1e-6)
    header = (tmp_path / "cloud.ply").read_bytes()[:400]
    assert b"property float nx" in header


def test_the_path_is_read_back_to_a_tenth_of_a_micrometre(tmp_path):
    points = np.random.default_rng(1).normal(size=(15, 3))
    writing.write_path(tmp_path / "path.csv", points, points)
    table = pl.read_csv(tmp_path / "path.csv")
    assert table.columns == ["x_m", "y_m", "z_m", "nx", "ny", "nz"]
    np.testing.assert_allclose(table.to_numpy()[:, :3], points, atol=1e-7)


def test_what_a_cut_off_scan_measured_lies_beside_earlier_results_until_the_next_good_one(
    tmp_path,
):
    with writing.staged(tmp_path) as folder:
        (folder / "metrics.json").write_text("first")
    whole = synthetic_log(np.random.default_rng(0))
    trajectory = replace(whole, s=np.where(whole.s > 0.012, np.nan, whole.s))
    error = SafetyError("contact force 10.2 N is above the limit", 10.2)
    error.add_note("the probe's body touched the chest plate")
    folder = writing.write_aborted(tmp_path, trajectory, error)
    told = json.loads((folder / "abort.json").read_text())
    assert (tmp_path / "metrics.json").read_text() == "first"
    np.testing.assert_array_equal(Trajectory.load(folder / LOG_FILE).s, trajectory.s)
    assert told["error"] == "SafetyError"
    assert told["message"] == "contact force 10.2 N is above the limit"
    assert told["notes"] == ["the probe's body touched the chest plate"]
    assert told["path_reached_m"] == np.nanmax(trajectory.s)
    with writing.staged(tmp_path):
        pass
    assert not folder.exists()
