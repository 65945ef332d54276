"""A data set as a sweep leaves it, drawn at random."""

import numpy as np
import polars as pl

VARIED = (
    "scene.phantom.young",
    "scan.contact.force",
    "scan.feedrate.speed",
    "scene.phantom.breast",
    "cell",
)
CAUSES = {
    "force jump": "SafetyError: the measured force jumped by 7.2 N in 8 ms, 5 N at most",
    "no breast": "NoBreastError: the cloud holds no breast: <script>on a plate</script>",
    "joint limit": "PlanningError: joint 4 cannot follow the path",
}


def data_set(n=200, *, seed=0, failed=0.2, repeats=1, varied=VARIED):
    """So many runs, a share of which failed, with settings of every kind."""
    rng = np.random.default_rng(seed)
    design = np.arange(n) // repeats
    young = 10 ** rng.uniform(3.3, 4.7, n)[design]
    force = rng.uniform(1, 6, n)[design]
    settings = {
        "scene.phantom.young": young,
        "scan.contact.force": force,
        "scan.feedrate.speed": rng.uniform(0.005, 0.03, n)[design],
        "scene.phantom.breast": rng.choice(["standard", "scattered", "cone"], n)[design],
        "cell": rng.integers(0, 3, n)[design],
    }
    stiff = np.log10(young / 1e3)
    rmse = 0.1 + 0.15 * stiff + 0.02 * force + rng.normal(0, 0.03, n)
    ends = rng.uniform(size=n) < failed * (2 * stiff / stiff.mean() - 1 if 0 < failed < 1 else 1)
    cause = np.where(ends, rng.choice(list(CAUSES), n, p=(0.6, 0.3, 0.1)), None)
    refused = np.isin(cause.astype(str), ("no breast", "joint limit"))
    metrics = {
        "executed_truth_rms_mm": 0.5 + 0.1 * force + rng.gamma(2, 0.1, n),
        "force_rmse_n": rmse,
        "force_any_peak_n": force + rng.gamma(2, 0.4, n),
        "surface_rmse_mm": rng.gamma(9, 0.02, n),
        "surface_density": 1 - rng.beta(1, 50, n),
        "normal_tilt_mean_deg": rng.gamma(4, 0.1, n),
        "contact_fraction": np.where(rng.uniform(size=n) < 0.95, 1.0, 0.97),
        "clearance_body_min_mm": rng.normal(60, 12, n),
        **{f"tracking_mean_abs_mm_{axis}": rng.gamma(4, 0.1, n) for axis in "xyz"},
        **{f"joint_speed_peak_rad_s_{k}": rng.gamma(4, 0.1, n) for k in range(1, 7)},
        **{f"wall_s_{stage}": rng.gamma(4, 0.5, n) for stage in ("plan", "execute")},
    }
    seen = ("surface_rmse_mm", "surface_density")
    measured = {
        name: np.where(refused if name in seen else ends, np.nan, values)
        for name, values in metrics.items()
    }
    frame = pl.DataFrame(
        {
            "run": np.arange(n),
            "design": design,
            "seed": rng.integers(0, 2**31, n),
            **{name: settings[name] for name in varied},
            **measured,
            "error": [CAUSES.get(name) for name in cause],
            "cause": list(cause),
            "touched": ~refused,
            "refused": refused,
            "wall_s": rng.gamma(20, 1, n),
            "cpu_s": rng.gamma(20, 1, n),
            "version": ["0.1.0"] * n,
            "commit": ["0123abc"] * n,
            "picture": [f"pictures/{name}.png" if name else None for name in cause],
            "command": [f"breastscan scan --seed {k}" for k in range(n)],
        },
        schema_overrides={
            "error": pl.String,
            "cause": pl.String,
            "picture": pl.String,
            **({"scene.phantom.breast": pl.String} if "scene.phantom.breast" in varied else {}),
        },
    )
    return frame.with_columns(pl.col(list(metrics)).fill_nan(None))
