"""Minimum joint motion along a path whose roll about the probe's axis is free: a graph, solved by
dynamic programming.

The graph's nodes are (pose of the path, roll, branch of the inverse kinematics). A branch is never
left: between two of them lies a singularity.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import se3

ROLLS = 72
"""Rolls of the graph, over a full rotation."""
ROLL_STEP = 2.0 * np.pi / ROLLS
"""Angle between them [rad]."""
KNEE_SPEED = 0.46
"""Joint speed from which on the cost grows with the eighth power instead of the second [rad/s]."""
SHIFTS = np.arange(-3, 4)
"""Rolls by which the next pose may differ."""


class BlockedError(PlanningError):
    """The arm cannot go on at some poses of a path; the error's value are their places in it."""

    reached = 0.0
    """Share of the path that lies before the first of them [-]."""


@dataclass(frozen=True, kw_only=True)
class RollGraph:
    """Joint angles and cost of every node."""

    q: Float[np.ndarray, "poses 72 8 6"]
    """Joint angles of each pose, roll and branch [rad]; NaN where there is no solution."""
    cost: Float[np.ndarray, "poses 72 8"]
    """What it costs to be there; infinite where the arm must not be."""
    durations: Float[np.ndarray, "steps"]
    """Time from each pose to the next [s]."""
    largest_step: float
    """Joint change above which two nodes are not joined [rad]: the arm would flip."""

    def minimum_motion(self) -> tuple[Float[np.ndarray, "poses"], int]:
        """Roll of each pose [rad], without jumps, and the branch, for the minimum integral of joint
        motion.

        That is the squared joint speed, with joints faster than `KNEE_SPEED` counting steeply more,
        so that no joint rushes in order to let the others rest.

        Raises:
            BlockedError: No path joins the first pose and the last.
        """
        edges = self._edges()
        value, origins = self.cost[0], []
        for edge, cost in zip(edges, self.cost[1:], strict=True):
            candidates = edge + np.stack([np.roll(value, shift, axis=0) for shift in SHIFTS])
            origins.append(np.argmin(candidates, axis=0))
            value = np.min(candidates, axis=0) + cost
            if not np.isfinite(value).any():
                pose = len(origins)
                raise BlockedError(
                    f"no joint path leads from pose {pose - 1} to pose {pose} of {len(self.q)} "
                    "along the path without passing a joint's limit, a singularity, its cell or "
                    "the body",
                    pose,
                )
        roll, branch = np.unravel_index(np.argmin(value), value.shape)
        return self._trace_back(origins, int(roll), int(branch)), int(branch)

    def _edges(self) -> Float[np.ndarray, "steps 7 72 8"]:
        """Joint motion of arriving at each node by each shift; infinite where the arm would
        flip.
        """
        arrivals = self.q[1:]
        edges = np.empty((len(arrivals), len(SHIFTS), ROLLS, arrivals.shape[2]))
        for k, shift in enumerate(SHIFTS):
            change = arrivals - np.roll(self.q[:-1], shift, axis=1)
            change -= 2.0 * np.pi * np.round(change / (2.0 * np.pi))
            allowed = np.abs(change).max(axis=-1) <= self.largest_step  # False for NaN
            edges[:, k] = np.where(allowed, _motion(change, self.durations[:, None, None]), np.inf)
        return edges

    def _trace_back(self, origins: list[np.ndarray], roll: int, branch: int) -> np.ndarray:
        shifts = []
        for origin in reversed(origins):
            shifts.append(SHIFTS[origin[roll, branch]])
            roll = (roll - shifts[-1]) % ROLLS
        return ROLL_STEP * (roll + np.append(0, np.cumsum(shifts[::-1])))


def _motion(change: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Squared joint speed, and more above the knee, summed over the joints and integrated over
    `duration` [s].
    """
    squared = (change / duration[..., None]) ** 2
    return np.sum(squared * (1.0 + (squared / KNEE_SPEED**2) ** 3), axis=-1) * duration


def rolled(
    X_BQ: Float[np.ndarray, "*b 4 4"], roll: Float[np.ndarray, "*b"]
) -> Float[np.ndarray, "*b 4 4"]:
    """Poses rotated about their own z axis by `roll` [rad]."""
    axis = np.zeros((*roll.shape, 3))
    return X_BQ @ se3.from_rotation_vector(axis + roll[..., None] * np.array([0.0, 0.0, 1.0]), axis)
