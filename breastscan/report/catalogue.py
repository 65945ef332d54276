"""The catalogue of what a run measures: which group a metric belongs to, its plain name, its
unit; and how a value is shown beside its bar.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from breastscan.run.bars import Bar

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
    smallest: float = 0.0
    """In the shown unit; what is below is rounding of numbers, and shown as less than this."""

    def text(self, value: Any) -> str:
        """A value as it is shown, without its unit."""
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, int | float):
            shown = value * self.scale
            return f"< {self.smallest:g}" if abs(shown) < self.smallest else number(shown)
        if isinstance(value, list):
            return " / ".join(self.text(entry) for entry in value)
        return str(value)

    def bar_text(self, bar: Bar) -> str:
        """A bar as it is shown, with its unit."""
        sign = "≤" if bar.sense == "at most" else "≥"
        return f"{sign} {number(bar.limit * self.scale)} {self.unit}".strip()


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured quantity, ready to print."""

    key: str
    group: str
    label: str
    value: str
    unit: str
    bar: str = ""
    """What it is held to, with its unit; empty where nothing is claimed."""
    verdict: str = ""
    """`HOLDS` or `MISSED`; empty where there is no bar."""


HOLDS, MISSED = "✓ holds", "✗ missed"


def _group(group: str, *entries: tuple[str, str, str, *tuple[float, ...]]) -> tuple[Metric, ...]:
    return tuple(_metric(group, *entry) for entry in entries)


def _metric(
    group: str, key: str, label: str, unit: str, scale: float = 1.0, smallest: float = 0.0
) -> Metric:
    return Metric(key=key, group=group, label=label, unit=unit, scale=scale, smallest=smallest)


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
        ("speed_fluctuation_pct", "Fluctuation of the planned speed", "%", 1.0, 0.01),
    ),
    *_group(
        "Execution",
        ("tracking_tangential_rmse_mm", "Tracking error across the normal, RMS", "mm"),
        ("executed_truth_mean_abs_mm", "Error to the true loop, mean absolute (x/y/z)", "mm"),
        ("executed_truth_rms_mm", "Error to the true loop, RMS", "mm"),
        ("normal_tilt_mean_deg", "Probe axis off the true normal, mean", "°"),
        ("clearance_body_min_mm", "Arm and tool from the body, the face aside, smallest gap", "mm"),
        ("breathing_amplitude_mm", "Chest's rise and fall, amplitude", "mm"),
        ("joint_speed_peak_rad_s", "Peak joint speed (1 to 6)", "°/s", math.degrees(1.0)),
    ),
    *_group(
        "Coverage",
        ("coverage_skin_pct", "Skin between the margins that was touched", "%"),
        ("coverage_twice_pct", "Touched by two strokes", "%"),
        ("coverage_volume_pct", "Tissue under it, to 40 mm, that a beam in contact passed", "%"),
        ("coverage_gap_mm2", "Skin that was not touched, by reason", "mm²"),
        ("examination_time_s", "Time of the examination", "s"),
    ),
    *_group(
        "Force",
        ("force_rmse_n", "Contact force about the set-point, RMS", "N"),
        ("force_peak_n", "Contact force, highest", "N"),
        ("force_min_n", "Contact force, lowest", "N"),
        ("force_any_peak_n", "Force on the body in any direction, highest", "N"),
        ("contact_fraction", "Loop time in contact", "%", 100.0),
    ),
    *_group(
        "Indentation, wanted",
        ("tracking_normal_rmse_mm", "Tip from the planned skin, along the normal, RMS", "mm"),
        ("indentation_max_mm", "Deepest indentation of the skin", "mm"),
        ("tracking_mean_abs_mm", "Tip from the planned skin, mean absolute (x/y/z)", "mm"),
        ("tracking_std_mm", "Tip from the planned skin, deviation (x/y/z)", "mm"),
    ),
    *_group(
        "Time",
        ("scan_time_s", "Duration of the scan", "s"),
        ("realtime_factor", "Simulated time over wall time", "×"),
        ("wall_s", "Wall time", "s"),
    ),
)


def metric_of(key: str) -> Metric:
    """How a metric is shown; one that the catalogue does not know under its own name."""
    known = (metric for metric in CATALOGUE if metric.key == key)
    return next(known, Metric(key=key, group=OTHER, label=key, unit=""))


def rows(metrics: dict[str, Any], bars: Mapping[str, Bar]) -> list[Row]:
    """What was measured, in the catalogue's order, then whatever else `metrics` holds; each with
    its bar, if it has one. Absent stays absent.
    """
    known = [metric.key for metric in CATALOGUE]
    present = [key for key in known if metrics.get(key) is not None]
    others = [key for key in metrics if key not in known]
    return [
        row
        for key in (*present, *others)
        for row in _rows_of(metric_of(key), metrics[key], bars.get(key))
    ]


def number(value: float) -> str:
    """Three significant digits, whole numbers from a thousand on, a dash for what is not finite."""
    if not math.isfinite(value):
        return "–"
    return f"{value:,.0f}" if abs(value) >= THOUSAND else f"{value:.3g}"


def _rows_of(metric: Metric, value: Any, bar: Bar | None) -> Iterator[Row]:
    """One row, or one for each entry where the value is a dictionary."""
    if isinstance(value, dict):
        for name, entry in value.items():
            yield _row(metric, f"{metric.label}, {name}", entry, None)
    else:
        yield _row(metric, metric.label, value, bar)


def _row(metric: Metric, label: str, value: Any, bar: Bar | None) -> Row:
    row = Row(
        key=metric.key,
        group=metric.group,
        label=label,
        value=metric.text(value),
        unit=metric.unit,
    )
    if bar is None or not isinstance(value, int | float):
        return row
    return replace(row, bar=metric.bar_text(bar), verdict=HOLDS if bar.holds(value) else MISSED)
