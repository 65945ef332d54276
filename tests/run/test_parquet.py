"""The log as any reader of Parquet finds it: flat columns with units in the names, described."""

import json

import numpy as np
import polars
import pytest

from breastscan.errors import ConfigError
from breastscan.run import columns, parquet
from breastscan.run.columns import LOG, TRUTH
from breastscan.run.provenance import version_of
from breastscan.run.trajectory import Trajectory
from tests.run.synthetic_run import synthetic_log


@pytest.fixture(scope="module")
def log():
    return synthetic_log(np.random.default_rng(0)).take(np.arange(2000, 4000))


@pytest.fixture
def file(tmp_path, log):
    log.save(tmp_path / "log.parquet", seed=7)
    return tmp_path / "log.parquet"


def test_every_column_holds_one_value_a_row_in_the_order_of_the_table(file, log):
    table = polars.read_parquet(file)
    assert tuple(table.columns) == columns.names(LOG)
    assert not any(dtype.is_nested() for dtype in table.dtypes)
    assert len(table) == len(log.t)


def test_the_columns_hold_what_their_names_say(file, log):
    table = polars.read_parquet(file)
    np.testing.assert_array_equal(table["t_s"], log.t)
    np.testing.assert_array_equal(table["q2_rad"], log.q[:, 1])
    np.testing.assert_array_equal(table["qd6_plan_rad_s"], log.qd_plan[:, 5])
    np.testing.assert_array_equal(table["tip_z_m"], log.X_BP[:, 2, 3])
    np.testing.assert_array_equal(table["force_z_n"], log.wrench_P[:, 2])
    np.testing.assert_array_equal(table["torque_x_nm"], log.wrench_P[:, 3])


def test_the_file_says_where_it_came_from_and_what_its_columns_are(file):
    told = polars.read_parquet_metadata(file)
    assert told["seed"] == "7"
    assert told["breastscan"] == version_of("breastscan")
    assert {"date", "command", "versions", "frames"} <= set(told)
    described = json.loads(told["columns"])
    assert tuple(described) == columns.names(LOG)
    assert described["force_z_n"]["unit"] == "N"
    assert described["force_z_n"]["frame"] in json.loads(told["frames"])


def test_a_turning_probe_has_smooth_quaternions(tmp_path):
    angle = np.linspace(0.0, 4 * np.pi, 500)
    X_SP = np.tile(np.eye(4), (len(angle), 1, 1))
    X_SP[:, 0, 0] = X_SP[:, 1, 1] = np.cos(angle)
    X_SP[:, 1, 0], X_SP[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rows = dict.fromkeys(("time", "force_axial", "depth", "rise", "rigid_force"), angle)
    nothing = np.full(len(angle), "")
    values = {**rows, "q": np.zeros((len(angle), 6)), "chest_S": np.zeros((len(angle), 3)),
              "of_arm": nothing, "of_other": nothing, "X_SP": X_SP}  # fmt: skip
    parquet.write(tmp_path / "truth.parquet", TRUTH, values)
    q = polars.read_parquet(tmp_path / "truth.parquet", columns=["tip_qw_phantom"]).to_series()
    np.testing.assert_allclose(q, np.cos(angle / 2), atol=1e-12)
    read = parquet.read(tmp_path / "truth.parquet", TRUTH)
    np.testing.assert_allclose(read["X_SP"], X_SP, atol=1e-12)


def test_a_log_without_a_column_is_refused_by_the_columns_name(file):
    polars.read_parquet(file).drop("qd3_rad_s").write_parquet(file)
    with pytest.raises(ConfigError, match=r"lacks the columns qd3_rad_s: .* run the scan again"):
        Trajectory.load(file)


def test_a_log_of_an_earlier_version_is_refused_and_told_to_be_made_anew(file, log):
    nested = {"t": log.t, "q": log.q, "X_BP": log.X_BP.reshape(-1, 16)}
    polars.DataFrame(nested).write_parquet(file)
    with pytest.raises(ConfigError, match=r"t_s, phase, s_m and .* earlier version; run the scan"):
        Trajectory.load(file)


def test_an_empty_log_is_refused(file):
    polars.read_parquet(file).clear().write_parquet(file)
    with pytest.raises(ConfigError, match="holds no sample"):
        Trajectory.load(file)


@pytest.mark.parametrize("spoilt", [polars.lit("fast"), polars.lit(None, polars.Float64)])
def test_a_column_that_holds_something_else_is_refused(file, spoilt):
    polars.read_parquet(file).with_columns(qd1_rad_s=spoilt).write_parquet(file)
    with pytest.raises(ConfigError, match=r"column qd1_rad_s .* should hold a number"):
        Trajectory.load(file)
