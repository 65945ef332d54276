"""Shares of known functions are found, and told with what they are worth."""

import numpy as np
import pytest
import scipy.stats

from experiments.budget.design import ALL, FIRST, NONE, SECOND, all_but, alone, exchanged
from experiments.budget.estimates import Budget, Level, budget, indices

A, B = 7.0, 0.1
"""Of the function of Ishigami."""


def ishigami(x):
    return np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0])


def three(function, dists, n, seed=0):
    """A function of two samples, and of the first with each factor exchanged."""
    unit = scipy.stats.qmc.Sobol(2 * len(dists), rng=np.random.default_rng(seed)).random(n).T
    first = np.array([d.ppf(u) for d, u in zip(dists, unit, strict=False)])
    second = np.array([d.ppf(u) for d, u in zip(dists, unit[len(dists) :], strict=True)])
    changed = []
    for factor in range(len(dists)):
        own = first.copy()
        own[factor] = second[factor]
        changed.append(function(own))
    return function(first), function(second), np.array(changed)


def test_indices_of_ishigamis_function_are_the_exact_ones():
    dists = [scipy.stats.uniform(-np.pi, 2 * np.pi)] * 3
    first, total, groups = indices(*three(ishigami, dists, 4096))
    one, two = 0.5 * (1 + B * np.pi**4 / 5) ** 2, A**2 / 8
    third = 8 * B**2 * np.pi**8 / 225
    variance = one + two + third
    assert groups == 4096
    assert first[:, 0] == pytest.approx(np.array([one, two, 0.0]) / variance, abs=0.02)
    assert total[:, 0] == pytest.approx(np.array([one + third, two, third]) / variance, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_indices_are_those_of_scipy(seed):
    """SciPy's take powers of two only, and so no sample from which groups were dropped."""
    values = three(ishigami, [scipy.stats.uniform(-np.pi, 2 * np.pi)] * 3, 64, seed)
    first, total, _ = indices(*values)
    f_A, f_B, f_AB = values
    names = {"f_A": f_A[None], "f_B": f_B[None], "f_AB": f_AB[:, None]}
    oracle = scipy.stats.sobol_indices(func=names, n=64)
    assert first[:, 0] == pytest.approx(oracle.first_order, abs=1e-12)
    assert total[:, 0] == pytest.approx(oracle.total_order, abs=1e-12)


def test_groups_with_a_gap_are_left_out_whole():
    values = three(ishigami, [scipy.stats.uniform(-np.pi, 2 * np.pi)] * 3, 64)
    gaps = [np.array(v, copy=True) for v in values]
    gaps[0][3] = gaps[1][10] = gaps[2][1, 40] = np.nan
    kept = np.delete(np.arange(64), [3, 10, 40])
    first, total, groups = indices(*gaps)
    whole = indices(values[0][kept], values[1][kept], values[2][:, kept])
    assert groups == 61
    assert np.array_equal(first, whole[0])
    assert np.array_equal(total, whole[1])


def test_a_large_mean_does_not_spoil_the_indices():
    values = three(ishigami, [scipy.stats.uniform(-np.pi, 2 * np.pi)] * 3, 64)
    first = indices(*values)[0]
    raised = indices(*(v + 1e6 for v in values))[0]
    assert raised == pytest.approx(first, abs=1e-6)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Over samples of an additive model, at about 95 %; bootstrap intervals of 64 are a bit
    short.
    """
    shares = np.array([0.6, 0.3, 0.1])
    rng, held = np.random.default_rng(0), []
    for _ in range(60):
        a, b = rng.standard_normal((2, 64, 3)) * np.sqrt(shares)
        changed = [a.sum(1) - a[:, k] + b[:, k] for k in range(3)]
        total = indices(a.sum(1), b.sum(1), np.array(changed))[1]
        low, high = np.quantile(total[:, 1:], (0.025, 0.975), axis=1)
        held.append((low <= shares) & (shares <= high))
    assert 0.85 < np.mean(held) <= 1.0


PARTS = {"large": 2.0, "small": 0.5, "none of it": 0.0}
"""Mean squares that three sources add."""
FLOOR = 1.0


def sets(count=20, samples=16, seed=0):
    """Errors that add in the mean square, each row by another draw."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.5, 1.5, (2, max(count, samples), len(PARTS))) * list(PARTS.values())
    few = a[:count]
    found = {NONE: np.array([0.0]), ALL: few.sum(1)}
    for k, name in enumerate(PARTS):
        found[alone(name)], found[all_but(name)] = few[:, k], few.sum(1) - few[:, k]
        found[exchanged(name)] = (a.sum(1) - a[:, k] + b[:, k])[:samples]
    found[FIRST], found[SECOND] = a.sum(1)[:samples], b.sum(1)[:samples]
    return {name: np.sqrt(FLOOR + square) for name, square in found.items()}


def test_alone_and_all_but_one_agree_where_errors_add():
    found = budget(sets(), list(PARTS), [])
    whole = found.levels[ALL].value ** 2
    for one in found.contributions:
        assert one.added.value == pytest.approx(one.saved.value, abs=1e-12)
        assert one.added.value == pytest.approx(PARTS[one.source] / whole, abs=0.12)
        assert one.alone.value**2 - FLOOR == pytest.approx(one.added.value * whole)
        low, high = one.saved.interval.low, one.saved.interval.high
        assert low <= one.saved.value <= high
    assert found.floor.value == pytest.approx(FLOOR / whole)
    assert found.unattributed.value == pytest.approx(0.0, abs=1e-12)
    for view in ("added", "saved", "total"):
        assert found.largest(view, 5) == ["large", "small"]


def test_what_is_there_in_company_only_is_told_apart():
    errors = sets()
    together = errors[ALL] ** 2 + 2.0
    changed = errors | {ALL: np.sqrt(together)}
    for name in PARTS:
        changed[all_but(name)] = errors[all_but(name)]
    found = budget(changed, list(PARTS), [])
    assert found.unattributed.value == pytest.approx(2.0 / together.mean())


def test_a_pair_counts_where_both_scans_ended_well():
    errors = sets()
    errors[ALL][:5] = np.nan
    errors[all_but("large")][3:8] = np.nan
    found = budget(errors, list(PARTS), [])
    kept = errors[ALL][8:] ** 2 - errors[all_but("large")][8:] ** 2
    (large,) = [c for c in found.contributions if c.source == "large"]
    assert large.saved.value == pytest.approx(kept.mean() / np.mean(errors[ALL][5:] ** 2))
    assert found.levels[ALL] == Level(np.sqrt(np.mean(errors[ALL][5:] ** 2)), 15)
    assert large.all_but.n == 15


@pytest.mark.parametrize("lost", [NONE, ALL, FIRST])
def test_what_cannot_be_told_is_not_told(lost):
    errors = sets()
    errors[lost][:] = np.nan
    found = budget(errors, list(PARTS), [])
    assert isinstance(found, Budget)
    told = {NONE: "added", ALL: "saved", FIRST: "total"}[lost]
    assert {getattr(c, told).text for c in found.contributions} == {"–"}
    assert found.largest(told, 5) == []


def test_few_scans_have_no_interval():
    found = budget(sets(count=2, samples=2), list(PARTS), [])
    large = found.contributions[0]
    assert np.isfinite(large.added.value)
    assert np.isnan(large.added.interval.low)
    assert "…" not in large.added.text
