"""What was measured is shown, grouped and in plain units; what was not is not invented."""

import math

import pytest

from breastscan.report import catalogue
from tests.run.synthetic_run import METRICS


def shown(metrics):
    return {row.label: f"{row.value} {row.unit}".strip() for row in catalogue.rows(metrics)}


def test_every_metric_of_a_whole_run_is_known_by_name():
    assert {row.group for row in catalogue.rows(METRICS)} == {
        "Perception",
        "Path",
        "Execution",
        "Force",
        "Time",
    }


def test_groups_come_in_the_order_of_the_pipeline():
    groups = list(dict.fromkeys(row.group for row in catalogue.rows(METRICS)))
    assert groups == ["Perception", "Path", "Execution", "Force", "Time"]


def test_absent_metrics_are_not_shown():
    assert list(shown({"force_rmse_n": 0.06})) == ["Contact force about the set-point, RMS"]
    assert catalogue.rows({}) == []


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
    rows = catalogue.rows({"swell_mm": 1.5, "valid": True, "note": "x", "force_rmse_n": 0.1})
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
