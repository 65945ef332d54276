"""Bars are data: each is stated once, and says itself which side of it is wanted."""

import math

import pytest

from breastscan.run import bars
from breastscan.run.bars import BARS, ESTIMATED, SCAN


def test_no_command_states_a_bar_twice():
    stated = [(bar.command, bar.key) for bar in BARS]
    assert len(set(stated)) == len(stated)


@pytest.mark.parametrize(
    ("key", "value", "holds"),
    [
        ("surface_rmse_mm", 0.5, True),
        ("surface_rmse_mm", 0.51, False),
        ("contact_fraction", 1.0, True),
        ("contact_fraction", 0.999, False),
    ],
)
def test_a_bar_holds_up_to_its_limit_and_on_its_own_side(key, value, holds):
    assert bars.bars_of(SCAN)[key].holds(value) is holds


@pytest.mark.parametrize("bar", BARS, ids=lambda bar: f"{bar.command}:{bar.key}")
def test_what_is_not_a_number_keeps_no_bar(bar):
    assert not bar.holds(math.nan)


def test_a_scan_with_an_estimated_rig_is_held_to_that_rigs_bars():
    perfect, estimated = bars.scan_bars({"rig": None}), bars.scan_bars({"rig": "cell/rig.yaml"})
    assert perfect["surface_rmse_mm"].limit == 0.5
    assert estimated["surface_rmse_mm"] is bars.bars_of(ESTIMATED)["surface_rmse_mm"]
    assert estimated["force_rmse_n"] is perfect["force_rmse_n"]
