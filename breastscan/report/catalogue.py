"""The catalogue of what a run measures: which group a metric belongs to, its plain name, its
unit.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

OTHER = "Other"
"""Group of whatever the catalogue does not know."""

THOUSAND = 1000.0
"""From here on digits behind the point say nothing."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """How one entry of `metrics.json` is shown."""

    key: str
    group: str
    label: str
    unit: str
    scale: float = 1.0
    """Shown unit over stored unit: 100 for a fraction shown in per cent."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured quantity, ready to print."""

    key: str
    group: str
    label: str
    value: str
    unit: str


def _group(
    group: str, *entries: tuple[str, str, str] | tuple[str, str, str, float]
) -> tuple[Metric, ...]:
    return tuple(
        Metric(key=key, group=group, label=label, unit=unit, scale=scale[0] if scale else 1.0)
        for key, label, unit, *scale in entries
    )


CATALOGUE: tuple[Metric, ...] = (
    *_group(
        "Perception",
        ("surface_rmse_mm", "Surface error, RMS", "mm"),
        ("surface_p95_mm", "Surface error, 95th percentile", "mm"),
        ("surface_density", "Skin that has a reconstructed point", "%", 100.0),
        ("normal_mean_deg", "Error of the normals, mean", "°"),
        ("normal_p95_deg", "Error of the normals, 95th percentile", "°"),
        ("calibration_reprojection_px", "Reprojection residual", "px"),
        ("baseline_error_mm", "Error of the stereo baseline", "mm"),
        ("yaw_error_deg", "Error of the angle between the cameras", "°"),
        ("handeye_error_mm", "Hand-eye error, translation", "mm"),
        ("handeye_error_deg", "Hand-eye error, rotation", "°"),
    ),
    *_group(
        "Path",
        ("path_surface_rmse_mm", "Planned path to true skin, RMS", "mm"),
        ("speed_fluctuation_pct", "Fluctuation of the planned speed", "%"),
    ),
    *_group(
        "Execution",
        ("tracking_mean_abs_mm", "Tracking error, mean absolute (x/y/z)", "mm"),
        ("tracking_std_mm", "Tracking error, deviation (x/y/z)", "mm"),
        ("tracking_tangential_rmse_mm", "Tracking error, tangential RMS", "mm"),
        ("tracking_normal_rmse_mm", "Tracking error, normal RMS", "mm"),
        ("executed_truth_mean_abs_mm", "Error to the true loop, mean absolute (x/y/z)", "mm"),
        ("executed_truth_rms_mm", "Error to the true loop, RMS", "mm"),
        ("normal_tilt_mean_deg", "Probe axis off the true normal, mean", "°"),
        ("joint_speed_peak_rad_s", "Peak joint speed (1 to 6)", "°/s", math.degrees(1.0)),
    ),
    *_group(
        "Force",
        ("force_rmse_n", "Contact force about the set-point, RMS", "N"),
        ("force_peak_n", "Contact force, highest", "N"),
        ("force_min_n", "Contact force, lowest", "N"),
        ("contact_fraction", "Loop time in contact", "%", 100.0),
        ("indentation_max_mm", "Deepest indentation of the skin", "mm"),
    ),
    *_group(
        "Time",
        ("scan_time_s", "Duration of the scan", "s"),
        ("realtime_factor", "Simulated time over wall time", "×"),
        ("wall_s", "Wall time", "s"),
    ),
)


def rows(metrics: dict[str, Any]) -> list[Row]:
    """What was measured, in the catalogue's order, then whatever else `metrics` holds. Absent
    stays absent.
    """
    known = {metric.key for metric in CATALOGUE}
    others = (
        Metric(key=key, group=OTHER, label=key, unit="") for key in metrics if key not in known
    )
    present = [metric for metric in CATALOGUE if metrics.get(metric.key) is not None]
    return [row for metric in (*present, *others) for row in _rows_of(metric, metrics[metric.key])]


def number(value: float) -> str:
    """Three significant digits, whole numbers from a thousand on, a dash for what is not finite."""
    if not math.isfinite(value):
        return "–"
    return f"{value:,.0f}" if abs(value) >= THOUSAND else f"{value:.3g}"


def _rows_of(metric: Metric, value: Any) -> Iterator[Row]:
    """One row, or one for each entry where the value is a dictionary."""
    if isinstance(value, dict):
        for name, entry in value.items():
            yield _row(metric, f"{metric.label}, {name}", entry)
    else:
        yield _row(metric, metric.label, value)


def _row(metric: Metric, label: str, value: Any) -> Row:
    return Row(
        key=metric.key,
        group=metric.group,
        label=label,
        value=_text(value, metric.scale),
        unit=metric.unit,
    )


def _text(value: Any, scale: float) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return number(value * scale)
    if isinstance(value, list):
        return " / ".join(_text(entry, scale) for entry in value)
    return str(value)
