"""How many of many breasts are scanned well, with every error at once?

Shapes, sizes, stiffness and breath are drawn, and one of ten cells, each with an arm and an
estimated rig of its own (`assets/studies/population.yaml`).
"""

import math
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path

import polars

from breastscan.scan import ScanConfig
from experiments import study_sweep
from experiments.sweep.engine import Engine
from experiments.sweep.spec import SweepSpec, load
from experiments.sweep.statistics import percent

SPEC = Path(str(resources.files("assets"))) / "studies" / "population.yaml"
SET_POINT = ScanConfig().contact.force
"""Of the contact force [N]."""
CONDITIONS = {
    "contact_fraction": (1.0, 1.0),
    "force_min_n": (SET_POINT - 1.0, math.inf),
    "force_peak_n": (-math.inf, SET_POINT + 1.0),
    "force_any_peak_n": (-math.inf, 8.0),
    "clearance_body_min_mm": (0.0, math.inf),
    "surface_density": (0.95, math.inf),
    "executed_truth_rms_mm": (-math.inf, 1.5),
}
"""Least and greatest of the metrics of a scan that went well: in contact over the whole loop, the
true force held within 1 N, nobody pressed hard or touched by anything but the probe's face, and the
loop followed on a surface that was seen."""


MEASURED = (
    *CONDITIONS, "surface_rmse_mm", "normal_mean_deg", "normal_tilt_mean_deg", "force_rmse_n",
)  # fmt: skip
"""What the tables tell of."""


def spec(count: int | None) -> SweepSpec:
    """The population, of so many breasts.

    Raises:
        ConfigError: There are none.
    """
    whole = load(SPEC)
    return whole if count is None else replace(whole, count=count)


def run(
    spec: SweepSpec,
    out: Path,
    *,
    seed: int,
    engine: Engine,
    told: Callable[[int], None] = lambda done: None,
) -> polars.DataFrame:
    """Scan a population and judge it; leave `study.md` beside what every sweep leaves, as
    `study_sweep.run`.
    """
    frame = study_sweep.run(
        spec, out, seed=seed, engine=engine, name="population", judge=judged, told=told
    )
    (out / "study.md").write_text(tables(frame), encoding="utf-8")
    return frame


def judged(frame: polars.DataFrame) -> polars.DataFrame:
    """A data set with `success`, and in `cause` what a scan that ended well misses of it."""
    missed = [_missed(frame, name, low, high) for name, (low, high) in CONDITIONS.items()]
    told = polars.concat_list(missed).list.drop_nulls().list.join(", ")
    ended = polars.col("error").is_null()
    return frame.with_columns(
        success=ended & (told == ""),
        cause=polars.when(ended & (told != "")).then("Missed: " + told).otherwise("cause"),
    )


def tables(frame: polars.DataFrame) -> str:
    """How the scans of a judged population went, why others did not, and what was measured, as
    Markdown.
    """
    n = len(frame)
    success = frame["success"].to_numpy()
    refused = frame["refused"].fill_null(False).to_numpy()
    outcomes = {
        "success": int(success.sum()),
        "refused before contact": int(refused.sum()),
        "failed": int((~success & ~refused).sum()),
    }
    lines = ["| of all | scans | share (95 % interval) |", "|---|---|---|"]
    for name, count in outcomes.items():
        lines.append(f"| {name} | {count} | {100 * count / n:.1f} % ({percent(count, n)}) |")
    lines += ["", "| why not | scans | of them refused |", "|---|---|---|"]
    causes = frame.filter(~polars.col("success")).group_by("cause").agg(
        polars.len(), refused=polars.col("refused").sum()
    )  # fmt: skip
    for cause, count, early in causes.sort(["len", "cause"], descending=[True, False]).iter_rows():
        lines.append(f"| {cause} | {count} | {early} |")
    lines += ["", "| of all that touched | scans | median | 5 % | 95 % |", "|---|---|---|---|---|"]
    touching = frame.filter(polars.col("touched"))
    for name in (name for name in MEASURED if name in frame.columns):
        values = touching[name].drop_nulls()
        if len(values):
            low, median, high = (values.quantile(q, "linear") for q in (0.05, 0.5, 0.95))
            lines.append(f"| `{name}` | {len(values)} | {median:.3g} | {low:.3g} | {high:.3g} |")
    return "\n".join(lines) + "\n"


def _missed(frame: polars.DataFrame, name: str, low: float, high: float) -> polars.Expr:
    """The metric's name where it is out of bounds, or was not measured."""
    if name not in frame.columns:
        return polars.lit(name)
    within = polars.col(name).is_between(low, high)  # null where it was not measured
    return polars.when(within).then(None).otherwise(polars.lit(name))
