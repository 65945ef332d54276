"""The log of an executed scan, one sample a control period."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from breastscan.errors import ConfigError
from breastscan.run import parquet
from breastscan.run.columns import LOG

MM_PER_M = 1e3

APPROACH = "approach"
"""Name of the phase in which the probe comes to the skin."""
LOOP = "loop"
"""Name of the phase in which the probe follows the planned path."""
RESUME = "resume"
"""Of the one sample at which a scan that was cut off goes on; its row is where contact is to be
made again."""
OVERLAP = "overlap"
"""Of the loop after it as far as the scan had come before: each place counts once."""

LOG_FILE = "trajectory.parquet"
"""The log in the folder of a run."""
SIMULATED = ("true_force", "true_depth", "true_tilt")
"""Fields that only a simulation can fill; without them their columns are absent."""


NOWHERE = np.zeros(3)


class Sample(NamedTuple):
    """What is kept of one control period."""

    time: float
    """Robot's clock [s]."""
    phase: str
    """What the robot was doing."""
    row: float
    """Row of the plan where the arm should be, with a fraction; NaN off the path."""
    q: Float[np.ndarray, "6"]
    """Measured joint angles [rad]."""
    qd: Float[np.ndarray, "6"]
    """Measured joint speeds [rad/s]."""
    target: Float[np.ndarray, "6"]
    """Joint angles that were sent before them [rad]."""
    wrench_P: Float[np.ndarray, "6"]
    """Measured wrench at the tip in P, force first [N, N m]."""
    contact: bool
    """Whether the controller took the probe to touch."""
    shift_B: Float[np.ndarray, "3"] = NOWHERE
    """By what the reference was moved from the plan, along with drag and breath [m]."""


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
    """Robot's clock [s]."""
    phase: tuple[str, ...]
    """What the robot was doing: approach, settle, loop, retreat ..."""
    s: Float[np.ndarray, "n"]
    """Path length along the loop [m]."""
    q: Float[np.ndarray, "n 6"]
    """Measured joint angles [rad]."""
    qd: Float[np.ndarray, "n 6"]
    """Measured joint speeds [rad/s]."""
    target: Float[np.ndarray, "n 6"]
    """Joint angles that were sent [rad]."""
    q_plan: Float[np.ndarray, "n 6"]
    """Planned joint angles [rad]."""
    qd_plan: Float[np.ndarray, "n 6"]
    """Planned joint speeds [rad/s]."""
    X_BP: Float[np.ndarray, "n 4 4"]
    """Executed tip pose in the robot base."""
    X_BP_plan: Float[np.ndarray, "n 4 4"]
    """Planned tip pose in the robot base, moved along with what drags and breathes."""
    wrench_P: Float[np.ndarray, "n 6"]
    """Measured wrench at the tip in P, force first [N, N m]; pressing reads negative along z."""
    contact: Bool[np.ndarray, "n"]
    """Whether the controller took the probe to touch."""
    true_force: Float[np.ndarray, "n"] | None = None
    """True contact force along the probe axis, positive when pressing [N]."""
    true_depth: Float[np.ndarray, "n"] | None = None
    """True indentation of the tissue [m]."""
    true_tilt: Float[np.ndarray, "n"] | None = None
    """Angle of the probe axis against the true normal [rad]; NaN where nothing touches."""

    @property
    def elapsed(self) -> Float[np.ndarray, "n"]:
        """Time since the log began [s]."""
        return self.t - self.t[0]

    def parts(self) -> list[Float[np.ndarray, "k"]]:
        """The times of each part [s]: one, and one more for each time that the scan was resumed."""
        resumed = [row for row, phase in enumerate(self.phase) if phase == RESUME and row]
        return np.split(self.t, resumed)

    @property
    def in_loop(self) -> Bool[np.ndarray, "n"]:
        """Which samples belong to the loop."""
        return np.array(self.phase) == LOOP

    @property
    def time_on_stroke(self) -> Float[np.ndarray, "n"]:
        """Time since the loop began after the latest approach [s]; NaN off the loop."""
        phase, since = np.array(self.phase), np.full(len(self.t), np.nan)
        rows = np.flatnonzero(phase == LOOP)
        approaches = np.cumsum(phase == APPROACH)[rows]
        _, firsts = np.unique(approaches, return_index=True)
        begun = np.repeat(self.t[rows[firsts]], np.diff([*firsts, len(rows)]))
        since[rows] = self.t[rows] - begun
        return since

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
        elapsed = self.elapsed
        return [
            Span(phase=self.phase[start], start=float(elapsed[start]), end=float(elapsed[end]))
            for start, end in zip(starts, ends, strict=True)
        ]

    def path_errors_mm(self) -> Float[np.ndarray, "m 3"]:
        """Executed minus planned tip at equal path parameter, over the loop, in B [mm]."""
        error_B = self.X_BP[self.in_loop, :3, 3] - self.X_BP_plan[self.in_loop, :3, 3]
        return error_B * MM_PER_M

    def normal_errors_mm(self) -> Float[np.ndarray, "m"]:
        """The part of `path_errors_mm` along the planned outward normal: negative is deeper than
        planned [mm].
        """
        normal_B = -self.X_BP_plan[self.in_loop, :3, 2]
        return np.sum(self.path_errors_mm() * normal_B, axis=1)

    def tangential_errors_mm(self) -> Float[np.ndarray, "m"]:
        """The size of the part of `path_errors_mm` across the planned normal [mm]."""
        squared = np.sum(self.path_errors_mm() ** 2, axis=1) - self.normal_errors_mm() ** 2
        return np.sqrt(np.maximum(squared, 0.0))

    def take(self, rows: Int[np.ndarray, "k"]) -> "Trajectory":
        """Some of the samples."""
        arrays = {
            name: values[rows]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        return replace(self, phase=tuple(self.phase[row] for row in rows), **arrays)

    def between(self, s: Float[np.ndarray, "k"]) -> "Trajectory":
        """A loop at other path lengths [m] within its own, which rise: linear between its
        samples.
        """
        row = np.interp(s, self.s, np.arange(len(self.s)))
        nearest = self.take(row.round().astype(int))

        def linear(values: np.ndarray) -> np.ndarray:
            columns = [np.interp(s, self.s, column) for column in values.reshape(len(values), -1).T]
            return np.stack(columns, axis=1).reshape(len(s), *values.shape[1:])

        numbers = {
            name: values
            for name, values in vars(self).items()
            if getattr(values, "dtype", None) == np.float64
        }
        return replace(nearest, **{name: linear(values) for name, values in numbers.items()})

    def save(self, path: Path, *, seed: int | None = None) -> None:
        """Write the log with the columns of docs/data.md; the seed of its run is noted beside."""
        parquet.write(path, LOG, vars(self), seed)

    @staticmethod
    def load(path: Path) -> "Trajectory":
        """Read a log.

        Raises:
            ConfigError: The file is no log of a scan, lacks a column, or one does not hold what it
                should.
        """
        if not path.is_file():
            raise ConfigError(
                f"{path.parent} is not a run: expected a folder with {path.name}, as `breastscan "
                f"scan --out {path.parent}` writes it",
                path,
            )
        arrays = parquet.read(path, LOG, optional=SIMULATED)
        return Trajectory(phase=tuple(arrays.pop("phase").tolist()), **arrays)
