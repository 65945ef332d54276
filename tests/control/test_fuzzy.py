"""The fuzzy gains, against simpful's own inference and by their symmetry."""

import numpy as np
import pytest
import simpful
from hypothesis import given
from hypothesis import strategies as st

from breastscan.control import fuzzy
from breastscan.control.fuzzy import RULES, SETS, FuzzyGains
from breastscan.errors import ConfigError

SCALED = st.floats(-4.0, 4.0)


@pytest.fixture(scope="module")
def oracle():
    """The table as printed in simpful: triangular sets, product, Sugeno's centre average."""
    system = simpful.FuzzySystem(operators=["AND_PRODUCT"], show_banner=False)
    peaks = range(-3, 4)
    sets = [
        simpful.TriangleFuzzySet(peak - 1, peak, peak + 1, term=name)
        for peak, name in zip(peaks, SETS, strict=True)
    ]
    for variable in ("e", "de"):
        system.add_linguistic_variable(
            variable, simpful.LinguisticVariable(sets, universe_of_discourse=[-3, 3])
        )
    for peak, name in zip(peaks, SETS, strict=True):
        system.set_crisp_output_value(name, peak)
    for row, error in zip(RULES, SETS, strict=True):
        for (kp, kd), change in zip(row, SETS, strict=True):
            system.add_rules([f"IF (e IS {error}) AND (de IS {change}) THEN (kp IS {kp})"])
            system.add_rules([f"IF (e IS {error}) AND (de IS {change}) THEN (kd IS {kd})"])

    def answer(error, change):
        system.set_variable("e", float(np.clip(error, -3, 3)))
        system.set_variable("de", float(np.clip(change, -3, 3)))
        inferred = system.inference(["kp", "kd"])
        return inferred["kp"], inferred["kd"]

    return answer


def test_the_table_as_printed_is_what_simpful_infers(oracle):
    rng = np.random.default_rng(0)
    for error, change in rng.uniform(-3.5, 3.5, (150, 2)):
        np.testing.assert_allclose(
            fuzzy.infer_as_printed(error, change), oracle(error, change), atol=1e-12
        )


@pytest.mark.parametrize("error", [-2.4, -0.3, 1.1, 3.0])
def test_the_table_in_use_is_simpfuls_at_the_mirrored_place(oracle, error):
    for change in (-2.2, 0.0, 0.7, 2.9):
        mirrored = oracle(-abs(error), -np.sign(error) * change)
        np.testing.assert_allclose(fuzzy.infer(error, change), mirrored, atol=1e-12)


@given(error=SCALED.filter(lambda e: abs(e) > 1e-9), change=SCALED)
def test_pressing_too_hard_is_corrected_as_eagerly_as_too_softly(error, change):
    assert fuzzy.infer(error, change) == fuzzy.infer(-error, -change)


@given(error=SCALED, change=SCALED)
def test_the_rules_never_leave_their_universe(error, change):
    assert all(-3.0 <= value <= 3.0 for value in fuzzy.infer(error, change))


@given(error=SCALED, change=SCALED)
def test_gains_stay_within_their_swing_and_positive(error, change):
    gains = FuzzyGains()
    kp, kd = gains.at(error, 10.0 * change)
    assert abs(kp / gains.proportional - 1.0) <= gains.proportional_swing + 1e-12
    assert abs(kd / gains.derivative - 1.0) <= gains.derivative_swing + 1e-12
    assert kp > 0
    assert kd > 0


def test_a_big_and_growing_error_gets_the_largest_proportional_gain():
    gains = FuzzyGains()
    growing, shrinking = gains.at(2.0, 20.0)[0], gains.at(2.0, -20.0)[0]
    assert growing == pytest.approx(gains.proportional * (1.0 + gains.proportional_swing))
    assert shrinking < growing


def test_a_swing_that_could_turn_a_gain_negative_is_refused():
    with pytest.raises(ConfigError, match="derivative_swing"):
        FuzzyGains(derivative_swing=1.1)
