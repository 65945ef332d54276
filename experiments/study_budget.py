"""Which source of error costs a scan how much?

Twelve sources, each realistic or ideal (`assets/studies/budget.yaml`): alone, all, all but one, and
with their draws exchanged, for indices of variance.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from experiments import study_sweep
from experiments.budget import page
from experiments.budget.design import BudgetSpec
from experiments.budget.estimates import Budget, budget
from experiments.sweep.engine import Engine


def run(
    spec: BudgetSpec,
    out: Path,
    *,
    seed: int,
    engine: Engine,
    told: Callable[[int], None] = lambda done: None,
) -> dict[str, Budget]:
    """Scan, and attribute the errors; leave `budget.html`, its figure and `study.md` beside what
    every sweep leaves, as `study_sweep.run`.

    Returns:
        What is known of each error, by the metric's name.
    """
    scans = spec.scans(seed)
    scans.write_rigs()
    frame = study_sweep.run(spec, out, seed=seed, engine=engine, name="budget", told=told)
    budgets = {
        metric: budget(errors(frame, metric, scans.sets), spec.vary, [*spec.tied])
        for metric in page.MEASURES
    }
    page.write(out, budgets, frame, scans, seed)
    return budgets


def errors(
    frame: pl.DataFrame, metric: str, sets: Mapping[str, list[int]]
) -> dict[str, Float[np.ndarray, "_"]]:
    """A metric of the scans of each set, NaN of those that did not end well.

    Args:
        frame: A row a run.
        metric: Its name.
        sets: Numbers of their runs.
    """
    measured = pl.col(metric) if metric in frame.columns else pl.lit(None, pl.Float64)
    found = frame.select(pl.when(pl.col("error").is_null()).then(measured).alias(metric))
    values = found[metric].cast(pl.Float64).fill_null(np.nan).to_numpy()
    return {name: values[numbers] for name, numbers in sets.items()}
