"""The log of an executed scan, one sample a control period, as `trajectory.parquet` holds it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars
from jaxtyping import Bool, Float

from breastscan.errors import ConfigError

MM_PER_M = 1e3

LOOP = "loop"
"""Name of the phase in which the probe follows the planned path."""

REQUIRED = ("t", "phase", "s", "q", "qd", "q_plan", "qd_plan", "X_BP", "X_BP_plan", "wrench")
"""Columns without which a log cannot be reported."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """An uninterrupted stretch of one phase."""

    phase: str
    start: float
    """Time of its first sample [s]."""
    end: float
    """Time at which the next phase begins; for the last phase, of its last sample [s]."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """An executed scan. What was planned is NaN outside the loop; truth is None on hardware."""

    t: Float[np.ndarray, "n"]
    """Time since the log began [s]."""
    phase: tuple[str, ...]
    """What the robot was doing: approach, settle, loop, retreat ..."""
    s: Float[np.ndarray, "n"]
    """Path length along the loop [m]."""
    q: Float[np.ndarray, "n 6"]
    """Measured joint angles [rad]."""
    qd: Float[np.ndarray, "n 6"]
    """Measured joint speeds [rad/s]."""
    q_plan: Float[np.ndarray, "n 6"]
    """Planned joint angles [rad]."""
    qd_plan: Float[np.ndarray, "n 6"]
    """Planned joint speeds [rad/s]."""
    X_BP: Float[np.ndarray, "n 4 4"]
    """Executed tip pose in the robot base."""
    X_BP_plan: Float[np.ndarray, "n 4 4"]
    """Planned tip pose in the robot base."""
    wrench_P: Float[np.ndarray, "n 6"]
    """Measured wrench at the tip in P, force first [N, N m]; pressing reads negative along z."""
    true_force: Float[np.ndarray, "n"] | None
    """True contact force along the probe axis, positive when pressing [N]."""
    true_depth: Float[np.ndarray, "n"] | None
    """True indentation of the tissue [m]."""
    true_tilt: Float[np.ndarray, "n"] | None
    """Angle of the probe axis against the true normal [rad]."""

    @property
    def in_loop(self) -> Bool[np.ndarray, "n"]:
        """Which samples belong to the loop."""
        return np.array(self.phase) == LOOP

    @property
    def has_loop(self) -> bool:
        """Whether enough of the loop was driven to speak of errors along it."""
        return bool(np.count_nonzero(self.in_loop) > 1)

    @property
    def pressing_force(self) -> Float[np.ndarray, "n"]:
        """Measured contact force along the probe axis, positive when pressing [N]."""
        return -self.wrench_P[:, 2]

    def spans(self) -> list[Span]:
        """The phases in the order in which they came."""
        names = np.array(self.phase)
        starts = np.flatnonzero(np.r_[True, names[1:] != names[:-1]])
        ends = np.r_[starts[1:], len(names) - 1]
        return [
            Span(phase=self.phase[start], start=float(self.t[start]), end=float(self.t[end]))
            for start, end in zip(starts, ends, strict=True)
        ]

    def path_errors_mm(self) -> Float[np.ndarray, "m 3"]:
        """Executed minus planned tip at equal path parameter, over the loop, in B [mm]."""
        error_B = self.X_BP[self.in_loop, :3, 3] - self.X_BP_plan[self.in_loop, :3, 3]
        return error_B * MM_PER_M

    def normal_errors_mm(self) -> Float[np.ndarray, "m"]:
        """The part of `path_errors_mm` along the planned outward normal: negative is deeper than planned [mm]."""
        normal_B = -self.X_BP_plan[self.in_loop, :3, 2]
        return np.sum(self.path_errors_mm() * normal_B, axis=1)

    def tangential_errors_mm(self) -> Float[np.ndarray, "m"]:
        """The size of the part of `path_errors_mm` across the planned normal [mm]."""
        squared = np.sum(self.path_errors_mm() ** 2, axis=1) - self.normal_errors_mm() ** 2
        return np.sqrt(np.maximum(squared, 0.0))

    @staticmethod
    def load(path: Path) -> "Trajectory":
        """Read a log.

        Raises:
            ConfigError: The file is no log of a scan, or lacks a column.
        """
        return Trajectory.from_table(_read(path), path)

    @staticmethod
    def from_table(table: polars.DataFrame, source: object = "the trajectory") -> "Trajectory":
        """The log that a table holds; `source` names it in errors.

        Raises:
            ConfigError: A column does not hold what it should.
        """

        def floats(name: str, *shape: int) -> np.ndarray:
            values = table[name].to_numpy().astype(float)
            if values.size != len(table) * int(np.prod(shape)):
                raise ConfigError(
                    f"{source}: column {name} should hold {shape} numbers a row; run the scan again", source
                )
            return values.reshape(len(table), *shape)

        def truth(name: str) -> np.ndarray | None:
            return floats(name) if name in table.columns else None

        time = floats("t")
        return Trajectory(
            t=time - time[0],
            phase=tuple(table["phase"].to_list()),
            s=floats("s"),
            q=floats("q", 6),
            qd=floats("qd", 6),
            q_plan=floats("q_plan", 6),
            qd_plan=floats("qd_plan", 6),
            X_BP=floats("X_BP", 4, 4),
            X_BP_plan=floats("X_BP_plan", 4, 4),
            wrench_P=floats("wrench", 6),
            true_force=truth("true_force"),
            true_depth=truth("true_depth"),
            true_tilt=truth("true_tilt"),
        )


def _read(path: Path) -> polars.DataFrame:
    try:
        table = polars.read_parquet(path)
    except (polars.exceptions.PolarsError, OSError) as error:
        raise ConfigError(f"{path} is not a Parquet file ({error}): run the scan again", path) from error
    missing = [name for name in REQUIRED if name not in table.columns]
    if missing or table.is_empty():
        fault = f"lacks the columns {', '.join(missing)}" if missing else "holds no sample"
        raise ConfigError(f"{path} {fault}: expected the log of a scan; run the scan again", path)
    return table
