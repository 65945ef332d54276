"""What can be said of many runs: shares and means with their intervals, and which setting moves
which metric.

Runs of one design point are no independent draws of the settings: means are resampled by design
point, and effects are of the means of the design points.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy.stats
from jaxtyping import Float, Int

from breastscan.report.catalogue import number
from experiments.sweep.quantities import SUCCESS

CONFIDENCE = 0.95
"""Of every interval."""
RESAMPLES = 2000
"""Of a bootstrap."""
RESAMPLED_AT_ONCE = 4_000_000
"""Numbers that a bootstrap holds in memory."""
CORRECTED_UP_TO = 500
"""Design points up to which a bootstrap is corrected for bias and skewness (BCa), which takes the
square of their number; beyond, the percentiles differ by nothing."""
CLEAR = 0.05
"""Share of false finds up to which an effect is taken for one."""
SEED = 0
"""Of the bootstraps: a page is the same whenever it is made."""
MAX_GROUPS = 6
"""Groups that a setting's values are parted into."""
SMALLEST_GROUP = 4
"""Design points that a group of numbers should hold."""
MIN_PAIRS = 4
"""From which a rank correlation has an interval."""
OTHERS = "other"
"""Group of the words beyond the most frequent."""


@dataclass(frozen=True)
class Interval:
    """Where a value lies, with a confidence of 95 %; NaN where too few runs tell it."""

    low: float
    high: float

    @property
    def text(self) -> str:
        """As it is shown."""
        return f"{number(self.low)} … {number(self.high)}" if np.isfinite(self.low) else "–"


UNKNOWN = Interval(np.nan, np.nan)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The runs that measured one quantity, in its unit."""

    n: int
    mean: float
    deviation: float
    """About the mean, of a sample; NaN of a single run."""
    median: float
    p5: float
    p95: float
    interval: Interval
    """Of the mean."""


@dataclass(frozen=True, kw_only=True)
class Groups:
    """A setting's values, parted."""

    labels: list[str]
    index: Int[np.ndarray, "n"]
    """Which group a row belongs to."""
    centres: Float[np.ndarray, "groups"] | None
    """Mean value of each; None of words."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """One group of a setting's values."""

    label: str
    centre: float | None
    """Mean of the setting in it; None of words."""
    n: int
    """Runs."""
    mean: float
    """Of the quantity."""
    interval: Interval
    """Of that mean."""


@dataclass(frozen=True, kw_only=True)
class Correlation:
    """Spearman's rank correlation."""

    value: float
    interval: Interval
    chance: float
    """Of one at least as strong where nothing is related."""

    @property
    def text(self) -> str:
        """As it is shown."""
        return f"ρ = {signed(self.value)}"


@dataclass(frozen=True, kw_only=True)
class Effect:
    """What one setting does to one quantity, whatever the others are."""

    setting: str
    quantity: str
    strength: float
    """Share of the variance between design points that the setting's groups explain, 0 to 1."""
    chance: float
    """Share of false finds among the effects that are as clear as this one, or clearer."""
    correlation: Correlation | None
    """None of words, and where nothing differs."""
    lowest: float
    """Least mean of a group, in the quantity's unit."""
    highest: float
    """Greatest mean of a group."""

    @property
    def is_clear(self) -> bool:
        """Whether chance hardly makes one like it."""
        return self.chance <= CLEAR


def wilson(successes: int, n: int) -> Interval:
    """Interval of a share, of runs that are drawn independently [Wilson]."""
    found = scipy.stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(float(found.low), float(found.high))


def percent(successes: int, n: int) -> str:
    """The interval of a share, as it is shown."""
    found = wilson(successes, n)
    return f"{100 * found.low:.1f} … {100 * found.high:.1f} %"


def mean_interval(values: Float[np.ndarray, "n"], designs: Int[np.ndarray, "n"]) -> Interval:
    """Bootstrap interval of the mean, resampled by design point; of a constant, the constant.

    Args:
        values: Of a quantity.
        designs: Number of each one's design point; there must be two or more.
    """
    _, place = np.unique(designs, return_inverse=True)
    counts = np.bincount(place).astype(float)
    sums = np.bincount(place, weights=values)
    if len(counts) < 2:
        return UNKNOWN
    means = sums / counts
    if np.allclose(means, means[0], rtol=1e-12, atol=0.0):
        return Interval(float(means[0]), float(means[0]))
    found = scipy.stats.bootstrap(
        (sums, counts),
        lambda total, count, axis: total.sum(axis=axis) / count.sum(axis=axis),
        paired=True,
        n_resamples=RESAMPLES,
        batch=max(1, RESAMPLED_AT_ONCE // len(counts)),
        confidence_level=CONFIDENCE,
        method="BCa" if len(counts) <= CORRECTED_UP_TO else "percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Interval(float(found.low), float(found.high))


def summary(frame: pl.DataFrame, quantity: str) -> Summary:
    """Of the runs that measured a quantity; there must be one."""
    rows = frame.drop_nulls(quantity)
    values = rows[quantity].to_numpy()
    p5, median, p95 = np.quantile(values, (0.05, 0.5, 0.95))
    return Summary(
        n=len(values),
        mean=float(values.mean()),
        deviation=float(values.std(ddof=1)) if len(values) > 1 else np.nan,
        median=float(median),
        p5=float(p5),
        p95=float(p95),
        interval=mean_interval(values, rows["design"].to_numpy()),
    )


def rank_correlation(x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n"]) -> Correlation | None:
    """Spearman's, with the interval of Fisher's transform and the variance of [Bonett]; None of
    too few, or where one of both is constant.
    """
    if len(x) < MIN_PAIRS or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    value, chance = map(float, scipy.stats.spearmanr(x, y))
    z = np.arctanh(np.clip(value, -1 + 1e-12, 1 - 1e-12))
    reach = scipy.stats.norm.ppf((1 + CONFIDENCE) / 2) * np.sqrt((1 + value**2 / 2) / (len(x) - 3))
    interval = Interval(float(np.tanh(z - reach)), float(np.tanh(z + reach)))
    return Correlation(value=value, interval=interval, chance=chance)


def signed(value: float) -> str:
    """A correlation with its sign, and none for what is nothing."""
    return f"{round(value, 2) + 0.0:+.2f}"


def grouped(values: pl.Series) -> Groups:
    """Part a setting's values: few numbers each for itself, many into groups of about equal size,
    words by their frequency.
    """
    if not values.dtype.is_numeric():
        return _words(values)
    numbers = values.to_numpy().astype(float)
    different = np.unique(numbers)
    return _each(numbers, different) if len(different) <= MAX_GROUPS else _ranks(numbers)


def _words(words: pl.Series) -> Groups:
    frequent = [word for word, _ in Counter(words).most_common()]
    labels = sorted(frequent)
    if len(frequent) > MAX_GROUPS:
        labels = [*sorted(frequent[: MAX_GROUPS - 1]), OTHERS]
    index = [labels.index(word) if word in labels else len(labels) - 1 for word in words]
    return Groups(labels=labels, index=np.array(index), centres=None)


def _each(numbers: Float[np.ndarray, "n"], different: Float[np.ndarray, "groups"]) -> Groups:
    labels = [f"{value:g}" for value in different]
    return Groups(labels=labels, index=np.searchsorted(different, numbers), centres=different)


def _ranks(numbers: Float[np.ndarray, "n"]) -> Groups:
    """By rank; equal numbers stay together."""
    count = np.clip(len(numbers) // SMALLEST_GROUP, 2, MAX_GROUPS)
    place = np.floor(count * (scipy.stats.rankdata(numbers) - 0.5) / len(numbers))
    _, index = np.unique(place, return_inverse=True)
    members = [numbers[index == group] for group in range(index.max() + 1)]
    return Groups(
        labels=[f"{own.min():.3g} … {own.max():.3g}" for own in members],
        index=index,
        centres=np.array([own.mean() for own in members]),
    )


def by_design(
    frame: pl.DataFrame, varied: Sequence[str], quantities: Sequence[str]
) -> pl.DataFrame:
    """A row a design point: its settings, and the mean of each quantity over its runs."""
    return frame.group_by("design", maintain_order=True).agg(
        *(pl.col(name).first() for name in varied),
        *(pl.col(name).mean() for name in quantities),
    )


def effects(frame: pl.DataFrame, varied: Sequence[str], quantities: Sequence[str]) -> list[Effect]:
    """What each setting does to each quantity, the strongest first; settings and quantities that
    do not differ are left out.
    """
    points = by_design(frame, varied, quantities)
    found = [
        effect
        for setting in varied
        for quantity in quantities
        if (effect := _effect(points.drop_nulls((setting, quantity)), setting, quantity))
        is not None
    ]
    if not found:
        return []
    shares = scipy.stats.false_discovery_control([effect.chance for effect in found])
    judged = [
        replace(effect, chance=float(share)) for effect, share in zip(found, shares, strict=True)
    ]
    return sorted(judged, key=lambda effect: -effect.strength)


def _effect(points: pl.DataFrame, setting: str, quantity: str) -> Effect | None:
    """One setting's, with the chance of the single test, by groups [Kruskal] or by ranks,
    whichever is clearer; None where nothing differs.
    """
    values = points[quantity].to_numpy()
    if len(values) < 2 or np.ptp(values) == 0:
        return None
    groups = grouped(points[setting])
    parts = [values[groups.index == group] for group in range(len(groups.labels))]
    if len(parts) < 2 or len(values) <= len(parts):
        return None
    means = [float(part.mean()) for part in parts]
    correlation, chance = None, float(scipy.stats.kruskal(*parts).pvalue)
    if groups.centres is not None:
        correlation = rank_correlation(points[setting].to_numpy(), values)
    if correlation is not None:
        chance = min(1.0, 2 * min(chance, correlation.chance))  # of two tests
    return Effect(
        setting=setting,
        quantity=quantity,
        strength=_explained(parts, values),
        chance=chance,
        correlation=correlation,
        lowest=min(means),
        highest=max(means),
    )


def _explained(parts: Sequence[Float[np.ndarray, "_"]], values: Float[np.ndarray, "n"]) -> float:
    """Share of the variance that lies between the parts, less what chance alone puts there: the
    squared epsilon of [Kelley], an estimate of Sobol's index of first order.
    """
    within = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
    return max(0.0, 1.0 - within / (len(values) - len(parts)) / float(values.var(ddof=1)))


def levels(frame: pl.DataFrame, setting: str, quantity: str) -> list[Level]:
    """Mean of a quantity in each group of a setting, over the runs that measured it."""
    rows = frame.drop_nulls((setting, quantity))
    groups = grouped(rows[setting])
    return [
        _level(groups, group, rows.filter(pl.Series(groups.index == group)), quantity)
        for group in range(len(groups.labels))
    ]


def _level(groups: Groups, group: int, rows: pl.DataFrame, quantity: str) -> Level:
    values = rows[quantity].to_numpy()
    share = quantity == SUCCESS.key
    return Level(
        label=groups.labels[group],
        centre=None if groups.centres is None else float(groups.centres[group]),
        n=len(values),
        mean=float(values.mean()),
        interval=wilson(round(values.sum()), len(values))
        if share
        else mean_interval(values, rows["design"].to_numpy()),
    )
