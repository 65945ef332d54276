import pytest

from breastscan.robot.ur.ur5e import PERIOD
from experiments.free_swing import swing


def test_a_free_arm_keeps_its_energy_for_ten_seconds():
    """No friction, no drives, no compensation: the mechanics themselves, at the twin's own time
    step.
    """
    assert swing("RK4", PERIOD).largest < 1e-4


def test_the_drift_falls_with_the_fourth_power_of_the_step_as_runge_kutta_promises():
    coarse, fine = (swing("RK4", step, duration=4.0).largest for step in (0.008, 0.004))
    assert coarse / fine == pytest.approx(16, rel=0.2)


def test_the_twins_own_integrator_drifts_by_a_few_percent_at_most():
    """First order: it is paired with drives and friction that take a thousand times as much out
    of the arm.
    """
    assert swing("Euler", PERIOD).largest == pytest.approx(0.01, abs=0.01)
