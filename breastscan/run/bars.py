"""The bars that measured quantities are held to: what is claimed, as data.

README's table of results, the summary in the terminal and `report.html` read them here; how a
quantity is called, and in which unit it is shown, stands in `breastscan.report.catalogue`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Sense = Literal["at most", "at least"]

SCAN = "breastscan scan --seed N"
CALIBRATE = "breastscan calibrate --twin --seed N --out rig"
HANDEYE = "breastscan handeye --twin --seed N --rig rig/rig.yaml --out cell"
ESTIMATED = "breastscan scan --seed N --rig cell/rig.yaml"
"""A scan that sees with the rig that the two commands before it found."""


@dataclass(frozen=True, kw_only=True)
class Bar:
    """What one entry of `metrics.json` must not pass."""

    key: str
    """Of `metrics.json`; its end names the unit of `limit`."""
    sense: Sense
    """Which side of the limit is wanted."""
    limit: float
    """In the unit of the key."""
    command: str
    """What measures it."""

    def holds(self, value: float) -> bool:
        """Whether a measured value keeps the bar; what is not a number does not."""
        return value <= self.limit if self.sense == "at most" else value >= self.limit


def _bars(command: str, *rows: tuple[str, Sense, float]) -> tuple[Bar, ...]:
    return tuple(
        Bar(key=key, sense=sense, limit=limit, command=command) for key, sense, limit in rows
    )


BARS: tuple[Bar, ...] = (
    *_bars(
        SCAN,
        ("surface_rmse_mm", "at most", 0.5),
        ("surface_density", "at least", 0.95),
        ("normal_mean_deg", "at most", 2.0),
        ("path_surface_rmse_mm", "at most", 0.5),
        ("executed_truth_rms_mm", "at most", 1.5),
        ("tracking_tangential_rmse_mm", "at most", 0.6),
        ("normal_tilt_mean_deg", "at most", 1.0),
        ("force_rmse_n", "at most", 0.5),
        ("force_peak_n", "at most", 8.0),
        ("contact_fraction", "at least", 1.0),
        ("indentation_max_mm", "at most", 8.0),  # to where the tissue was validated
    ),
    *_bars(
        CALIBRATE,
        ("calibration_reprojection_px", "at most", 0.10),
        ("baseline_error_mm", "at most", 0.05),
        ("yaw_error_deg", "at most", 0.005),
    ),
    *_bars(
        HANDEYE,
        ("handeye_error_mm", "at most", 0.2),
        ("handeye_error_deg", "at most", 0.02),
    ),
    *_bars(
        ESTIMATED,
        ("surface_rmse_mm", "at most", 0.3),
        ("surface_density", "at least", 0.95),
    ),
)
"""Every bar, in the order in which they are shown."""


def bars_of(command: str) -> dict[str, Bar]:
    """The bars of one command by the metric's key."""
    return {bar.key: bar for bar in BARS if bar.command == command}


def scan_bars(settings: Mapping[str, Any]) -> dict[str, Bar]:
    """The bars of a scan with these settings, as `config.json` holds them: with an estimated rig
    those of such a rig come before those of every scan.
    """
    estimated = settings.get("rig") is not None
    return bars_of(SCAN) | (bars_of(ESTIMATED) if estimated else {})
