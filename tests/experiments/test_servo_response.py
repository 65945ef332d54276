import numpy as np
import pytest

from experiments.servo_response import respond
from sim.arm.servo import ServoConfig


@pytest.fixture(scope="module")
def fastest():
    return respond(ServoConfig())


def test_every_joint_of_the_simulated_arm_trails_a_ramp_by_34_ms(fastest):
    np.testing.assert_allclose(fastest.ramp_lag, 0.034, atol=0.5e-3)


def test_half_of_a_step_is_done_after_34_ms_with_little_overshoot(fastest):
    np.testing.assert_allclose(fastest.half_time, 0.034, atol=2e-3)
    assert fastest.overshoot < 0.1


def test_the_drives_do_what_servoj_asks_of_them(fastest):
    assert np.abs(fastest.step - fastest.law[:, None]).max() < 0.06
