import polars as pl
import pytest

from breastscan.errors import ConfigError
from experiments.sweep.quantities import main_quantities, measured, prepared, quantity_of
from tests.experiments.sweep.synthetic_sweep import VARIED, data_set


@pytest.mark.parametrize(
    ("column", "title"),
    [
        ("force_rmse_n", "Contact force about the set-point, RMS [N]"),
        ("joint_speed_peak_rad_s_3", "Peak joint speed, 3 [°/s]"),
        ("tracking_mean_abs_mm_x", "Tip from the planned skin, mean absolute, x [mm]"),
        ("wall_s_plan", "Wall time, plan [s]"),
        ("wall_s", "Wall time [s]"),
        ("swell_mm", "swell_mm [mm]"),
        ("swell", "swell"),
    ],
)
def test_a_column_is_shown_under_its_plain_name_with_its_unit(column, title):
    assert quantity_of(column).title == title


def test_settings_and_bookkeeping_are_not_measured():
    found = {quantity.key for quantity in measured(data_set(20), VARIED)}
    assert {"force_rmse_n", "wall_s", "cpu_s", "wall_s_plan"} <= found
    assert not found & {"run", "design", "seed", *VARIED}


def test_main_metrics_that_no_run_measured_are_left_out():
    frame = data_set(20, failed=1)
    keys = {quantity.key for quantity in main_quantities(measured(frame, VARIED))}
    assert keys == {"surface_rmse_mm", "surface_density"}


def test_numbers_come_in_shown_units_and_what_is_not_finite_as_null():
    frame = data_set(3, failed=0).with_columns(
        pl.Series("surface_density", [0.5, float("nan"), float("inf")])
    )
    assert prepared(frame, VARIED)["surface_density"].to_list() == [50.0, None, None]


def test_success_is_no_error_or_what_the_data_set_says():
    frame = pl.DataFrame(
        {"run": [0, 1, 2], "design": [0, 1, 2], "error": [None, "E: e", None], "refused": False}
    )
    assert prepared(frame, ())["success"].to_list() == [1, 0, 1]
    told = frame.with_columns(pl.Series("success", [False, None, None]))
    assert prepared(told, ())["success"].to_list() == [0, 0, 1]


def test_a_setting_without_a_value_is_a_word_of_its_own():
    frame = data_set(4).with_columns(pl.Series("cell", [None, "a", None, "b"]))
    assert prepared(frame, VARIED)["cell"].to_list() == ["none", "a", "none", "b"]


@pytest.mark.parametrize(("values", "words"), [([True, False], "True"), ([[1, 2], [3]], "[1, 2]")])
def test_what_is_no_number_is_a_word(values, words):
    frame = data_set(2).with_columns(pl.Series("cell", values))
    assert prepared(frame, VARIED)["cell"][0] == words


def test_an_empty_data_set_and_a_lacking_column_are_named():
    with pytest.raises(ConfigError, match="holds no run"):
        prepared(data_set(3).clear(), VARIED)
    with pytest.raises(ConfigError, match="lacks refused, scene"):
        prepared(data_set(3).drop("refused", VARIED[0]), VARIED)
