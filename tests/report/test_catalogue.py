"""What was measured is shown, grouped and in plain units; what was not is not invented."""

import math

import pytest

from breastscan.report import catalogue
from breastscan.run.bars import BARS, SCAN, bars_of
from tests.run.synthetic_run import METRICS


def shown(metrics):
    rows = catalogue.rows(metrics, {})
    return {row.label: f"{row.value} {row.unit}".strip() for row in rows}


def test_every_metric_of_a_whole_run_is_known_by_name():
    assert catalogue.OTHER not in {row.group for row in catalogue.rows(METRICS, {})}


def test_groups_come_in_the_order_of_the_pipeline():
    groups = list(dict.fromkeys(row.group for row in catalogue.rows(METRICS, {})))
    assert groups == ["Perception", "Path", "Execution", "Force", "Indentation, wanted", "Time"]


def test_absent_metrics_are_not_shown():
    assert list(shown({"force_rmse_n": 0.06})) == ["Contact force about the set-point, RMS"]
    assert catalogue.rows({}, {}) == []


def test_fractions_are_shown_in_per_cent_and_joint_speeds_in_degrees():
    values = shown(
        {
            "contact_fraction": 0.987,
            "joint_speed_peak_rad_s": [math.pi, 0.0, 0.0, 0.0, 0.0, math.pi / 2],
        }
    )
    assert values["Loop time in contact"] == "98.7 %"
    assert values["Peak joint speed (1 to 6)"] == "180 / 0 / 0 / 0 / 0 / 90 °/s"


def test_stages_of_the_wall_time_have_a_row_each():
    assert shown({"wall_s": {"plan": 0.5, "execute": 7.0}}) == {
        "Wall time, plan": "0.5 s",
        "Wall time, execute": "7 s",
    }


def test_unknown_metrics_are_shown_last_under_their_own_name():
    rows = catalogue.rows({"swell_mm": 1.5, "valid": True, "note": "x", "force_rmse_n": 0.1}, {})
    others = [(row.group, row.label, row.value) for row in rows]
    assert others[0][0] == "Force"
    assert others[1:] == [
        ("Other", "swell_mm", "1.5"),
        ("Other", "valid", "yes"),
        ("Other", "note", "x"),
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.08123, "0.0812"),
        (12.345, "12.3"),
        (0.0, "0"),
        (-3.0, "-3"),
        (12345.6, "12,346"),
        (2.1e-8, "2.1e-08"),
    ],
)
def test_numbers_keep_three_digits(value, text):
    assert catalogue.number(value) == text


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_is_a_dash(value):
    assert catalogue.number(value) == "–"


def test_what_is_rounding_of_numbers_is_shown_as_less_than_what_counts():
    assert shown({"speed_fluctuation_pct": 5.05e-9}) == {
        "Fluctuation of the planned speed": "< 0.01 %"
    }
    assert shown({"speed_fluctuation_pct": 0.02}) == {"Fluctuation of the planned speed": "0.02 %"}


def test_the_wanted_indentation_is_no_error():
    along_the_normal = ("tracking_normal_rmse_mm", "tracking_mean_abs_mm", "tracking_std_mm")
    for key in along_the_normal:
        metric = catalogue.metric_of(key)
        assert metric.group == "Indentation, wanted"
        assert "rror" not in metric.label


@pytest.mark.parametrize(
    ("metrics", "bar", "verdict"),
    [
        ({"surface_rmse_mm": 0.13}, "≤ 0.5 mm", "✓ holds"),
        ({"surface_rmse_mm": 0.6}, "≤ 0.5 mm", "✗ missed"),
        ({"surface_density": 0.9}, "≥ 95 %", "✗ missed"),
        ({"surface_rmse_mm": math.nan}, "≤ 0.5 mm", "✗ missed"),
        ({"surface_p95_mm": 0.2}, "", ""),
    ],
)
def test_a_value_stands_beside_its_bar_and_says_whether_it_holds(metrics, bar, verdict):
    (row,) = catalogue.rows(metrics, bars_of(SCAN))
    assert (row.bar, row.verdict) == (bar, verdict)


@pytest.mark.parametrize("key", sorted({bar.key for bar in BARS}))
def test_every_bar_is_of_a_metric_that_the_catalogue_names(key):
    assert catalogue.metric_of(key).group != catalogue.OTHER
