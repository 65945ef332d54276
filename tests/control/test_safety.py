import numpy as np
import pytest

from breastscan.control import safety
from breastscan.control.safety import SafetyLimits
from breastscan.errors import ConfigError, SafetyError

LIMITS = SafetyLimits()


def wrench(**parts):
    values = dict.fromkeys(("fx", "fy", "fz", "tx", "ty", "tz"), 0.0) | parts
    return np.array(list(values.values()))


def test_a_wrench_inside_every_limit_passes():
    safety.check_wrench(wrench(fz=-5.0, tx=0.1), LIMITS)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (wrench(fz=-15.1), "15.1 N"),
        (wrench(fx=11.0, fy=11.0), "force"),
        (wrench(ty=3.5), "torque"),
        (wrench(fz=np.nan), "not finite"),
        (wrench(tz=np.inf), "not finite"),
    ],
)
def test_a_wrench_beyond_a_limit_is_refused_and_kept(bad, reason):
    with pytest.raises(SafetyError, match=reason) as caught:
        safety.check_wrench(bad, LIMITS)
    assert caught.value.value is bad


def test_a_command_that_asks_for_too_much_speed_names_the_joint():
    before, after = np.zeros(6), np.zeros(6)
    after[3] = 0.0021  # 1.05 rad/s over 2 ms
    with pytest.raises(SafetyError, match="joint 4"):
        safety.check_command(after, before, 0.002, LIMITS)


def test_a_command_that_is_not_finite_is_refused():
    with pytest.raises(SafetyError, match="not finite"):
        safety.check_command(np.full(6, np.nan), np.zeros(6), 0.002, LIMITS)


def test_limits_must_be_positive():
    with pytest.raises(ConfigError, match="force"):
        SafetyLimits(force=0.0)
