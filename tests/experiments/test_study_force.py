import warnings
from dataclasses import replace

import numpy as np
import pytest

from breastscan.control.laws import LAW_NAMES
from experiments import force_cell, force_mode_cell, study_force
from experiments.force_cell import Cell

NOMINAL = Cell(law="observer", sensor="ideal")


@pytest.fixture(scope="module")
def nominal():
    return force_cell.run(NOMINAL)


def test_the_default_law_holds_five_newtons_on_the_twin(nominal):
    assert not nominal.ended
    assert nominal.inside
    assert nominal.rmse < 0.1
    assert nominal.sensor_rms < 1e-9
    assert nominal.overshoot < 0.3
    assert nominal.settling < 0.6
    assert max(nominal.tangential) < 0.1e-3
    assert nominal.highest < 6.75
    assert nominal.lowest > 2.5


def test_a_plan_that_misses_the_skin_is_followed_by_the_force():
    outcome = force_cell.run(replace(NOMINAL, surface_error=0.010))
    assert not outcome.ended
    assert outcome.rmse < 0.2


def test_a_skin_out_of_reach_is_told_as_the_supervisor_ends_it():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outcome = force_cell.run(replace(NOMINAL, surface_error=0.025))
    assert "above where it was planned" in outcome.ended
    assert outcome.highest < 15.0


def test_the_hypercube_visits_every_part_of_every_range():
    cells = study_force.cells(30, 0, "observer")
    assert len({cell.seed for cell in cells}) == 30
    for name, (low, high) in study_force.RANGES.items():
        values = np.sort([getattr(cell, name) for cell in cells])
        edges = np.linspace(low, high, 31)
        assert ((values >= edges[:-1]) & (values <= edges[1:])).all()
    for name, options in study_force.CHOICES.items():
        assert {getattr(cell, name) for cell in cells} == set(options)


def test_every_law_and_every_sensor_is_compared():
    assert set(study_force.LAW_NAMES) == set(LAW_NAMES)
    assert set(study_force.SENSORS) == {"ideal", "industrial", "ur5e_builtin"}


def test_the_controllers_own_force_mode_is_as_good_as_its_sensor():
    presses = force_mode_cell.run("ideal sensor", 0.25, 0)
    assert [p.force for p in presses] == list(force_mode_cell.FORCES)
    assert max(p.deviation for p in presses) < 0.1
    assert max(p.sliding for p in presses) < 1.0
    pressed = dict.fromkeys(force_mode_cell.ZEROED, presses)
    rows = [row for row in force_mode_cell.table(pressed, {}) if row.startswith("| force mode")]
    assert len(rows) == len(pressed)
