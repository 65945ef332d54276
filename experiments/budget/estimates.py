"""What the scans of a budget say of each source: what it adds by itself, what is saved without it,
and its share of the variance.

Errors that come from independent causes add in the mean square, so contributions are shares of the
mean square error of scans with all sources realistic; indices are shares of the variance of the
error itself. All intervals resample rows, which have their draws in common.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.report.catalogue import number
from experiments.budget.design import ALL, FIRST, NONE, SECOND, all_but, alone, exchanged
from experiments.sweep.statistics import CONFIDENCE, RESAMPLES, SEED, UNKNOWN, Interval

MIN_ROWS = 4
"""From which an interval says something."""


@dataclass(frozen=True)
class Estimate:
    """A share with its interval; NaN where too few scans ended well."""

    value: float
    interval: Interval

    @property
    def text(self) -> str:
        """As it is shown, in percent."""
        if not np.isfinite(self.value):
            return "–"
        low, high = self.interval.low, self.interval.high
        ends = f" ({100 * low:.0f} … {100 * high:.0f})" if np.isfinite(low) else ""
        return f"{100 * self.value:.0f}{ends}"


@dataclass(frozen=True)
class Level:
    """Root mean square of an error over the scans of a set that ended well."""

    value: float
    n: int

    @property
    def text(self) -> str:
        """As it is shown."""
        return f"{number(self.value)} ({self.n})"


@dataclass(frozen=True, kw_only=True)
class Contribution:
    """One source's part in one error."""

    source: str
    alone: Level
    """With this source only."""
    all_but: Level
    """With all others."""
    added: Estimate
    """Mean square that it adds where all else is ideal, over that with all sources."""
    saved: Estimate
    """Mean square that is saved where it is ideal and all else is not, over that with all."""
    first: Estimate
    """Share of the variance that it causes by itself."""
    total: Estimate
    """That it causes together with others."""


@dataclass(frozen=True, kw_only=True)
class Budget:
    """All that is known of one error."""

    levels: dict[str, Level]
    """Of the sets with all sources, and with none."""
    contributions: list[Contribution]
    floor: Estimate
    """Mean square where all sources are ideal, over that with all: what the method leaves."""
    unattributed: Estimate
    """Mean square with all that is neither there with none nor added by any alone, likewise."""
    interplay: Estimate
    """Share of the variance that no source causes by itself."""
    groups: int
    """For the indices: of which all scans ended well."""

    def largest(self, view: str, count: int) -> list[str]:
        """The sources that are largest in a view (`added`, `saved`, `total`), in order; those that
        are nothing are left out.
        """
        known = [(getattr(c, view).value, c.source) for c in self.contributions]
        return [source for value, source in sorted(known, reverse=True) if value > 0][:count]


def budget(
    errors: Mapping[str, Float[np.ndarray, "_"]], sources: Sequence[str], tied: Sequence[str]
) -> Budget:
    """What the scans say of one error.

    Args:
        errors: By the name of the set, a row each; NaN of a scan that did not end well.
        sources: Their names.
        tied: Names of further sets with all sources.
    """
    squares = {name: values**2 for name, values in errors.items()}
    everything, nothing = squares[ALL], squares[NONE]
    weights = _resamples(len(everything))
    whole = _mean(weights, everything)

    def share(values: Float[np.ndarray, "rows"]) -> tuple[Float[np.ndarray, "r"], int]:
        known = min(np.isfinite(values).sum(), np.isfinite(everything).sum())
        return _mean(weights, values) / whole, int(known)

    floor = share(np.broadcast_to(nothing, len(everything)))
    added = [share(squares[alone(s)] - nothing) for s in sources]
    saved = [share(everything - squares[all_but(s)]) for s in sources]
    left = 1.0 - floor[0] - np.sum([values for values, _ in added], axis=0)
    first, total, groups = indices(
        errors[FIRST], errors[SECOND], np.array([errors[exchanged(s)] for s in sources])
    )
    return Budget(
        levels={name: _level(errors[name]) for name in (ALL, *tied, NONE)},
        contributions=[
            Contribution(
                source=source,
                alone=_level(errors[alone(source)]),
                all_but=_level(errors[all_but(source)]),
                added=_estimate(*added[i]),
                saved=_estimate(*saved[i]),
                first=_estimate(first[i], groups),
                total=_estimate(total[i], groups),
            )
            for i, source in enumerate(sources)
        ],
        floor=_estimate(*floor),
        unattributed=_estimate(left, min(n for _, n in (floor, *added))),
        interplay=_estimate(1.0 - first.sum(axis=0), groups),
        groups=groups,
    )


def indices(
    first: Float[np.ndarray, "n"],
    second: Float[np.ndarray, "n"],
    exchanged: Float[np.ndarray, "k n"],
) -> tuple[Float[np.ndarray, "k r"], Float[np.ndarray, "k r"], int]:
    """Sobol's indices of first and of total order, by the estimators of [Saltelli 2010] and of
    Jansen, over the groups that are complete.

    Args:
        first: Values of a first sample.
        second: Values of a second one, independent.
        exchanged: Values of the first with one factor's draw from the second, a row a factor. NaN
            where there is no value.

    Returns:
        Both orders, of all groups and then of resampled ones; and how many groups are complete.
    """
    complete = np.isfinite(np.vstack([first, second, exchanged])).all(axis=0)
    groups = int(complete.sum())
    if groups < 2:
        unknown = np.full((len(exchanged), 1 + RESAMPLES), np.nan)
        return unknown, unknown, groups
    changed = exchanged[:, complete] - first[complete]
    centre = np.mean([first[complete], second[complete]])  # against rounding
    A, B = first[complete] - centre, second[complete] - centre
    weights = _resamples(groups) / groups
    mean = weights @ (A + B) / 2
    variance = weights @ (A**2 + B**2) / 2 - mean**2
    with np.errstate(invalid="ignore", divide="ignore"):
        of_first = (weights @ (B * changed).T - mean[:, None] * (weights @ changed.T)).T / variance
        of_total = (weights @ (changed**2).T).T / (2 * variance)
    return of_first, of_total, groups


def _resamples(rows: int) -> Float[np.ndarray, "r rows"]:
    """How often each row counts: once, and then in every resample."""
    rng = np.random.default_rng(SEED)
    drawn = rng.multinomial(rows, np.full(rows, 1 / rows), size=RESAMPLES)
    return np.vstack([np.ones(rows), drawn])


def _mean(
    weights: Float[np.ndarray, "r rows"], values: Float[np.ndarray, "rows"]
) -> Float[np.ndarray, "r"]:
    """Over the rows that have a value."""
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return weights[:, known] @ values[known] / weights[:, known].sum(axis=1)


def _estimate(values: Float[np.ndarray, "r"], rows: int) -> Estimate:
    """Of the scans as they are, which come first, with the percentiles of the resampled ones."""
    drawn = values[1:][np.isfinite(values[1:])]
    if rows < MIN_ROWS or len(drawn) < len(values) / 2:
        return Estimate(float(values[0]), UNKNOWN)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, (tail, 1 - tail))
    return Estimate(float(values[0]), Interval(float(low), float(high)))


def _level(values: Float[np.ndarray, "n"]) -> Level:
    known = values[np.isfinite(values)]
    return Level(float(np.sqrt(np.mean(known**2))) if len(known) else np.nan, len(known))
