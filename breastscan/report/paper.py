"""Table 4 of the paper, and how a run's path errors compare with it.

Source: X. Zhang et al., scanning path planning for breast ultrasound with NURBS and binocular
vision, Table 4 and Section V-B.2. The table prints its differences with mixed signs; here an error
is always actual minus theoretical.
"""

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

PUBLISHED: dict[str, Any] = yaml.safe_load(
    files("assets").joinpath("paper.yaml").read_text(encoding="utf-8")
)
"""What the paper prints, number for number, and its statement of every figure and table."""
TABLE4_THEORETICAL_MM: Float[np.ndarray, "15 3"] = np.array(PUBLISHED["table_4"])[:, 0]
"""The fifteen planned path points (x, y, z) in B [mm] [Zhang, Table 4]."""
TABLE4_ACTUAL_MM: Float[np.ndarray, "15 3"] = np.array(PUBLISHED["table_4"])[:, 1]
"""The points that the paper's robot reached, in the same order (x, y, z) in B [mm] [Zhang, Table
4]."""


@dataclass(frozen=True, kw_only=True)
class ErrorStatistics:
    """How large a set of path errors is, along each axis of B."""

    mean_abs_mm: Float[np.ndarray, "3"]
    """Mean of the absolute errors (x, y, z) [mm]; the paper's "average error"."""
    rms_mm: Float[np.ndarray, "3"]
    """Root mean square about zero (x, y, z) [mm]; what the paper prints as its "standard
    deviation"."""
    deviation_mm: Float[np.ndarray, "3"]
    """Sample standard deviation about the mean (x, y, z) [mm]."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One statistic of a run beside the same statistic of the paper's Table 4."""

    statistic: str
    ours_mm: Float[np.ndarray, "3"]
    """This run's (x, y, z) [mm]."""
    paper_mm: Float[np.ndarray, "3"]
    """The paper's (x, y, z) [mm]."""


def statistics(errors_mm: Float[np.ndarray, "n 3"]) -> ErrorStatistics:
    """Size of path errors, actual minus planned, given in B [mm].

    Raises:
        ValueError: There are fewer than two errors, so that no deviation exists.
    """
    if len(errors_mm) < 2:
        raise ValueError(
            f"expected at least two path errors, got {len(errors_mm)}: log a longer loop"
        )
    return ErrorStatistics(
        mean_abs_mm=np.abs(errors_mm).mean(axis=0),
        rms_mm=np.sqrt(np.mean(errors_mm**2, axis=0)),
        deviation_mm=errors_mm.std(axis=0, ddof=1),
    )


def table4_statistics() -> ErrorStatistics:
    """The paper's own errors, recomputed from the points it prints."""
    return statistics(TABLE4_ACTUAL_MM - TABLE4_THEORETICAL_MM)


def compare_table4(errors_mm: Float[np.ndarray, "n 3"]) -> tuple[Comparison, ...]:
    """A run's path errors, executed minus planned in B [mm], beside the paper's.

    The paper scanned a rigid print. On soft tissue the error along the normal contains the
    indentation.
    """
    ours, paper = statistics(errors_mm), table4_statistics()
    return (
        Comparison(
            statistic="mean absolute error", ours_mm=ours.mean_abs_mm, paper_mm=paper.mean_abs_mm
        ),
        Comparison(statistic="RMS about zero", ours_mm=ours.rms_mm, paper_mm=paper.rms_mm),
        Comparison(
            statistic="sample standard deviation",
            ours_mm=ours.deviation_mm,
            paper_mm=paper.deviation_mm,
        ),
    )
