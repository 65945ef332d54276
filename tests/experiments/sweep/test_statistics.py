"""Intervals against closed forms, and effects against models whose effects are known."""

import numpy as np
import polars as pl
import pytest
import scipy.stats

from experiments.sweep import statistics
from experiments.sweep.quantities import SUCCESS
from experiments.sweep.statistics import (
    effects,
    grouped,
    levels,
    mean_interval,
    rank_correlation,
    summary,
    wilson,
)

Z = 1.959963984540054


def linear_model(n=400, noise=1.0):
    """y = 3 a + b + noise over independent, uniform a, b and c of unit variance, and words."""
    rng = np.random.default_rng(1)
    a, b, c = rng.uniform(-np.sqrt(3), np.sqrt(3), (3, n))
    y = 3 * a + b + noise * rng.normal(size=n)
    columns = {"design": np.arange(n), "a": a, "b": b, "c": c, "word": rng.choice(["u", "v"], n)}
    return pl.DataFrame({**columns, "y": y, "success": (a < 0.5).astype(float)})


@pytest.mark.parametrize(("k", "n"), [(13, 30), (0, 30), (30, 30), (1, 1)])
def test_the_interval_of_a_share_is_wilsons(k, n):
    share, extra = k / n, Z**2 / n
    centre = (share + extra / 2) / (1 + extra)
    reach = Z / (1 + extra) * np.sqrt(share * (1 - share) / n + extra / (4 * n))
    found = wilson(k, n)
    assert found.low == pytest.approx(max(0, centre - reach), abs=1e-9)
    assert found.high == pytest.approx(min(1, centre + reach), abs=1e-9)


def test_the_bootstrap_covers_the_mean_of_a_normal_as_often_as_it_says():
    rng = np.random.default_rng(2)
    found = [mean_interval(rng.normal(5, 2, 40), np.arange(40)) for _ in range(100)]
    assert 88 <= sum(one.low <= 5 <= one.high for one in found) <= 99


@pytest.mark.parametrize("n", [400, 2000])
def test_the_bootstrap_of_many_is_that_of_the_normal(n):
    values = np.random.default_rng(3).normal(5, 2, n)
    reach = Z * values.std(ddof=1) / np.sqrt(n)
    found = mean_interval(values, np.arange(n))
    assert found.low == pytest.approx(values.mean() - reach, abs=0.15 * reach)
    assert found.high == pytest.approx(values.mean() + reach, abs=0.15 * reach)


def test_repeated_runs_of_a_design_point_say_no_more_than_one():
    values = np.random.default_rng(4).normal(size=30)
    once = mean_interval(values, np.arange(30))
    found = mean_interval(np.repeat(values, 5), np.repeat(np.arange(30), 5))
    assert (found.low, found.high) == pytest.approx((once.low, once.high))


def test_the_interval_of_a_constant_is_the_constant():
    found = mean_interval(np.full(20, 0.1), np.arange(20))
    assert (found.low, found.high) == pytest.approx((0.1, 0.1))


@pytest.mark.parametrize("values", [[1.0, 2.0], [1.0] * 99 + [0.9], [0.0, 0.0, 1.0]])
def test_few_values_and_ties_have_an_interval_around_the_mean(values):
    found = mean_interval(np.array(values), np.arange(len(values)))
    assert min(values) <= found.low <= np.mean(values) <= found.high <= max(values)


def test_a_single_run_has_no_interval():
    frame = pl.DataFrame({"design": [0, 1], "y": [2.0, None]})
    found = summary(frame, "y")
    assert (found.n, found.mean, found.median, found.p95) == (1, 2.0, 2.0, 2.0)
    assert np.isnan(found.deviation)
    assert found.interval.text == "–"


def test_a_summary_is_of_the_runs_that_measured_it():
    values = np.random.default_rng(5).gamma(2, size=101)
    frame = pl.DataFrame({"design": range(102), "y": [*values, None]})
    found = summary(frame, "y")
    assert found.n == 101
    assert found.deviation == pytest.approx(np.std(values, ddof=1))
    assert found.p5 == pytest.approx(np.sort(values)[5])
    assert found.median == pytest.approx(np.sort(values)[50])


def test_a_rank_correlation_is_spearmans_and_its_interval_covers():
    rng = np.random.default_rng(6)
    truth = 6 / np.pi * np.arcsin(0.6 / 2)  # of a normal pair whose correlation is 0.6
    covered = 0
    for _ in range(200):
        x, y = rng.multivariate_normal([0, 0], [[1, 0.6], [0.6, 1]], 60).T
        found = rank_correlation(x, y)
        assert found.value == pytest.approx(scipy.stats.spearmanr(x, y).statistic)
        covered += found.interval.low <= truth <= found.interval.high
    assert 180 <= covered <= 199


def test_a_perfect_order_has_the_correlation_one_and_a_constant_none():
    x = np.arange(10.0)
    assert rank_correlation(x, x**3).interval.high == pytest.approx(1.0)
    assert rank_correlation(x, np.ones(10)) is None
    assert rank_correlation(x[:3], x[:3]) is None


def test_the_strongest_setting_of_a_linear_model_comes_first_with_its_share_of_the_variance():
    found = effects(linear_model(), ("c", "b", "a", "word"), ["y"])
    assert [effect.setting for effect in found[:2]] == ["a", "b"]
    assert found[0].strength == pytest.approx(9 / 11, abs=0.06)
    assert found[1].strength == pytest.approx(1 / 11, abs=0.06)
    assert [effect.is_clear for effect in found] == [True, True, False, False]
    assert found[0].correlation.value > 0.8
    assert found[0].highest - found[0].lowest > 6


def test_an_effect_that_rises_and_falls_is_found_without_a_rank_correlation():
    rng = np.random.default_rng(7)
    x = rng.uniform(-1, 1, 300)
    frame = pl.DataFrame({"design": range(300), "x": x, "y": x**2 + rng.normal(0, 0.05, 300)})
    (found,) = effects(frame, ["x"], ["y"])
    assert found.strength > 0.6
    assert found.is_clear
    assert abs(found.correlation.value) < 0.2


def test_effects_on_success_and_of_words_are_found():
    frame = linear_model().with_columns(
        pl.when(pl.col("word") == "u").then(pl.col("y")).otherwise(pl.col("y") + 9).alias("z")
    )
    found = {(e.setting, e.quantity): e for e in effects(frame, ("a", "word"), ["z", "success"])}
    assert found["word", "z"].is_clear
    assert found["word", "z"].correlation is None
    assert found["a", "success"].correlation.value < -0.5


def test_chance_is_seldom_taken_for_an_effect():
    rng = np.random.default_rng(8)
    names = [f"x{k}" for k in range(10)]
    clear = 0
    for _ in range(20):
        frame = pl.DataFrame(rng.normal(size=(60, 12)), schema=[*names, "y", "z"])
        found = effects(frame.with_row_index("design"), names, ["y", "z"])
        clear += any(effect.is_clear for effect in found)
    assert clear <= 3


def test_effects_are_of_design_points_not_of_their_runs():
    frame = linear_model(30)
    repeated = pl.concat([frame] * 5)
    assert effects(repeated, ("a", "b"), ["y"]) == effects(frame, ("a", "b"), ["y"])


def test_what_does_not_differ_has_no_effect():
    frame = linear_model(20).with_columns(pl.lit(1.0).alias("flat"), pl.lit(2.0).alias("fixed"))
    assert effects(frame, ("fixed",), ["y"]) == []
    assert effects(frame, ("a",), ["flat"]) == []


def test_levels_hold_every_run_once_and_the_interval_of_a_share_is_wilsons():
    frame = linear_model(100)
    found = levels(frame, "a", SUCCESS.key)
    assert sum(level.n for level in found) == 100
    first = found[0]
    assert first.mean == 1.0
    assert first.interval == wilson(first.n, first.n)
    assert [level.centre for level in found] == sorted(level.centre for level in found)


def test_few_numbers_stand_each_for_itself_and_many_in_groups_of_equal_size():
    few = grouped(pl.Series([3.0, 1.0, 3.0, 2.0]))
    assert few.labels == ["1", "2", "3"]
    assert few.index.tolist() == [2, 0, 2, 1]
    many = grouped(pl.Series(np.random.default_rng(9).normal(size=600)))
    assert np.bincount(many.index).tolist() == [100] * statistics.MAX_GROUPS


@pytest.mark.parametrize("common", [-1.0, 99.0])
def test_equal_numbers_stay_together(common):
    values = pl.Series([common] * 95 + list(map(float, range(10))))
    index = grouped(values).index
    assert len(set(index[:95])) == 1
    assert index.max() >= 1


def test_rare_words_share_a_group():
    words = pl.Series(list("aaabbbcccdddeeefg"))
    found = grouped(words)
    assert found.labels == [*"abcde", "other"]
    assert np.bincount(found.index).tolist() == [3, 3, 3, 3, 3, 2]
