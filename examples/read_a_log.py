"""The log of a scan with polars alone: a number a column, units in the names (docs/data.md)."""

import polars as pl

log = pl.read_parquet("out/scan/trajectory.parquet")
phases = log.group_by("phase", maintain_order=True).agg(
    seconds=pl.len() * 0.002,
    highest_force_n=-pl.col("force_z_n").min(),
    deepest_mm=1e3 * pl.col("true_depth_m").max(),
)
print(phases)

loop = log.filter(pl.col("phase") == "loop")
over_plan_mm = 1e3 * (loop["tip_z_m"] - loop["tip_z_plan_m"])
print(f"along the loop {over_plan_mm.mean():.2f} mm over the plan, +- {over_plan_mm.std():.2f} mm")
