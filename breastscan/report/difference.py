"""Two scans of one plan side by side: what the second did otherwise, at equal path length over
the loop.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError
from breastscan.run.trajectory import MM_PER_M, Trajectory

STEP = 0.25e-3
"""Path length between two compared places [m]."""
MIN_OVERLAP = 5e-3
"""Path length that two loops must have in common to be compared [m]."""
FARTHEST = 0.03
"""Planned tips further apart than this at equal path length belong to scans of different places
[m]."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Two loops at the same path lengths; every difference is the second minus the first."""

    first: Trajectory
    second: Trajectory

    @property
    def s_mm(self) -> Float[np.ndarray, "n"]:
        """Path length [mm]."""
        return self.first.s * MM_PER_M

    @property
    def q_deg(self) -> Float[np.ndarray, "n 6"]:
        """Joint angles [deg]; a joint that is a turn further reads 360."""
        return np.rad2deg(self.second.q - self.first.q)

    @property
    def tip_mm(self) -> Float[np.ndarray, "n 3"]:
        """Executed tip in B [mm]."""
        return MM_PER_M * (self.second.X_BP[:, :3, 3] - self.first.X_BP[:, :3, 3])

    @property
    def plan_mm(self) -> Float[np.ndarray, "n"]:
        """Distance of the planned tips [mm]: 0 where both runs had one plan."""
        return MM_PER_M * np.linalg.norm(
            self.second.X_BP_plan[:, :3, 3] - self.first.X_BP_plan[:, :3, 3], axis=1
        )

    @property
    def normal_mm(self) -> Float[np.ndarray, "n"]:
        """The part of `tip_mm` along the first run's planned outward normal [mm]: positive is
        less deep.
        """
        return -np.sum(self.tip_mm * self.first.X_BP_plan[:, :3, 2], axis=1)

    @property
    def across_mm(self) -> Float[np.ndarray, "n"]:
        """The size of the part of `tip_mm` across that normal [mm]."""
        squared = np.sum(self.tip_mm**2, axis=1) - self.normal_mm**2
        return np.sqrt(np.maximum(squared, 0.0))

    @property
    def turn_deg(self) -> Float[np.ndarray, "n"]:
        """Angle between the two probes' orientations [deg]."""
        apart = np.linalg.norm(
            self.second.X_BP[:, :3, :3] - self.first.X_BP[:, :3, :3], axis=(1, 2)
        )
        return np.rad2deg(2 * np.arcsin(np.minimum(apart / np.sqrt(8), 1.0)))

    @property
    def force(self) -> Float[np.ndarray, "n"]:
        """Measured pressing force [N]."""
        return self.second.pressing_force - self.first.pressing_force

    @property
    def true_force(self) -> Float[np.ndarray, "n"] | None:
        """True pressing force [N]; None unless both know it."""
        if self.first.true_force is None or self.second.true_force is None:
            return None
        return self.second.true_force - self.first.true_force

    @property
    def time(self) -> Float[np.ndarray, "n"]:
        """How much later the second comes to a place, both from the first compared place on [s]."""
        return self.second.elapsed - self.first.elapsed

    def quantities(self) -> dict[str, Float[np.ndarray, "n"]]:
        """Every difference by its name, the unit at its end."""
        named = {f"joint_{k + 1}_deg": self.q_deg[:, k] for k in range(6)}
        named |= {f"tip_{axis}_mm": self.tip_mm[:, index] for index, axis in enumerate(AXES)}
        named |= {
            "tip_normal_mm": self.normal_mm,
            "tip_across_mm": self.across_mm,
            "probe_turn_deg": self.turn_deg,
        }
        named |= {"plan_mm": self.plan_mm, "force_n": self.force}
        if self.true_force is not None:
            named["true_force_n"] = self.true_force
        return named | {"time_s": self.time}


def difference(first: Trajectory, second: Trajectory, names: tuple[str, str]) -> Difference:
    """Compare two scans over the path length that their loops share; `names` are told in errors.

    Raises:
        ConfigError: One has no loop, or they do not overlap: in path length, or in the place that
            they scan.
    """
    loops = [
        _loop(trajectory, name) for trajectory, name in zip((first, second), names, strict=True)
    ]
    start, end = max(loop.s[0] for loop in loops), min(loop.s[-1] for loop in loops)
    if end - start < MIN_OVERLAP:
        ranges = " and ".join(
            f"{loop.s[0] * MM_PER_M:.0f} .. {loop.s[-1] * MM_PER_M:.0f} mm" for loop in loops
        )
        raise ConfigError(
            f"the two runs do not overlap: their loops cover {ranges} of the path, expected "
            f"{MIN_OVERLAP * MM_PER_M:g} mm or more in common",
            (start, end),
        )
    s = np.linspace(start, end, round((end - start) / STEP) + 1)
    found = Difference(first=loops[0].between(s), second=loops[1].between(s))
    nearest = float(found.plan_mm.min()) / MM_PER_M
    if nearest > FARTHEST:
        raise ConfigError(
            "the two runs do not overlap: at equal path length their planned tips are "
            f"{nearest * MM_PER_M:.0f} mm apart or more, expected {FARTHEST * MM_PER_M:g} mm at "
            "most: compare scans of one place, in one frame",
            nearest,
        )
    return found


def _loop(trajectory: Trajectory, name: str) -> Trajectory:
    """The loop of a log, each path length as it is reached for the first time; `name` names it
    in errors.
    """
    rows = np.flatnonzero(trajectory.in_loop & np.isfinite(trajectory.s))
    s = trajectory.s[rows]
    rows = rows[s > np.maximum.accumulate(np.r_[-np.inf, s[:-1]])]
    if len(rows) < 2:
        raise ConfigError(
            f"{name} holds no loop to compare: expected a scan that was on its path", name
        )
    return trajectory.take(rows)


def statistics(found: Difference) -> dict[str, dict[str, float]]:
    """Mean, RMS, the largest value by its size, and where on the path that is [mm], of every
    quantity.
    """
    table = {}
    for name, values in found.quantities().items():
        worst = int(np.abs(values).argmax())
        table[name] = {
            "mean": float(values.mean()),
            "rms": float(np.sqrt(np.mean(values**2))),
            "largest": float(values[worst]),
            "largest_at_mm": float(found.s_mm[worst]),
        }
    return table
