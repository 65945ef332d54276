"""Redundancy resolution: the roll of the probe about its axis along a path and the branch of the
inverse kinematics on which the arm follows, for the minimum joint motion over all of it.

The probe may roll about its own axis, and the arm reaches a pose on up to eight branches. The
choice is made on poses some millimetres apart (`planning.roll_graph`) among what no limit bars
(`planning.candidates`); its rolls are then smoothed within what is allowed beside them, and held
against the limits again. Where no roll helps, the probe leans away from the normal, there and no
farther than needed.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import BSpline
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from breastscan.planning import probe_poses
from breastscan.planning.candidates import Candidates, Limits
from breastscan.planning.clearance import Clearance
from breastscan.planning.joint_limits import Corrections, JointPathConfig
from breastscan.planning.roll_graph import ROLL_STEP, ROLLS, BlockedError, RollGraph, rolled

SMOOTHING_WIDTHS = (3.0, 1.5, 0.75)
"""Widths (standard deviations) of the average that takes the graph's steps out of the roll, in
poses of the graph: the first that keeps every limit is taken."""
SMOOTHING_ROUNDS = 10
"""How often a smoothed roll is taken back into what is allowed, and smoothed again."""
BETWEEN = 2
"""Smoothed poses that are held against the limits, for each of the graph's."""
FREE_ROLL = math.pi / 2 - 1e-9
"""Roll tolerance from which on every roll is allowed [rad]."""
LARGEST_STEP = 0.6
"""Joint change from pose to pose above which the arm would flip [rad]."""
TILT_STEP = math.radians(2.5)
"""By how much more the probe leans at a time, where no roll helps [rad]."""
TILT_REACH = 6
"""How many poses before and after those it leans at as much, before it comes up again."""


@dataclass(frozen=True, kw_only=True)
class RedundancyResolution:
    """The roll, the tilt and the branch chosen for a path, independent of its timing."""

    roll: BSpline
    """Roll of the probe about its axis [rad], over the fraction of the path's length."""
    tilt: BSpline
    """How far the axis leans from the normal towards the mean normal [rad], over the same."""
    branch: int
    """Index into `kinematics.inverse_branches`."""
    mean_normal_B: Float[np.ndarray, "3"]
    """The mean of the path's normals."""
    is_free: bool
    """Whether the roll is measured from the `steady_poses` about it, or from how the array is to
    lie on the path."""
    along: bool
    """Whether that is along the path, or across it."""

    @property
    def largest_tilt(self) -> float:
        """How far the probe leans from the normal at most [rad]."""
        return float(np.max(self.tilt.c))

    def poses(
        self, positions_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 4 4"]:
        """Probe poses X_BP along the path."""
        s = probe_poses.lengths(positions_B)
        fraction = s / s[-1]
        if self.largest_tilt > 0.0:
            normals_B = probe_poses.tilted(normals_B, self.mean_normal_B, self.tilt(fraction))
        X_BQ = _without_roll(positions_B, normals_B, self.mean_normal_B, self.is_free, self.along)
        return rolled(X_BQ, self.roll(fraction))


def resolve(
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    config: JointPathConfig,
    clearance: Clearance | None = None,
    corrections: Corrections | None = None,
    *,
    along: bool = False,
    q_before: Float[np.ndarray, "6"] | None = None,
) -> RedundancyResolution:
    """The roll and branch of minimum joint motion that break no limit and keep clear of body and
    cell; with the least tilt that allows any.

    Args:
        positions_B: Probe tip at every control period, in B [m].
        normals_B: Outward unit normals of the skin there.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        config: Limits, margins and the freedom of the roll and the tilt.
        clearance: Measures distances from the arm itself, its cell and the body; None leaves them
            out.
        corrections: What the controller may add; None leaves that out.
        along: Whether the array is to lie along the path, not across it, where the roll is not
            free.
        q_before: Joint angles that the path is begun from [rad]; None for wherever it begins best.

    Raises:
        PlanningError: Some point cannot be reached, or no joint path joins the reachable poses.
    """
    limits = Limits(X_FP=X_FP, config=config, clearance=clearance, corrections=corrections)
    attempt = _Attempt(positions_B, normals_B, period, limits, along, q_before)
    needed = np.zeros(len(attempt.nodes))
    first: BlockedError | None = None
    while True:
        try:
            return attempt.resolution(needed)
        except BlockedError as error:
            blocked = np.atleast_1d(np.asarray(error.value))
            error.reached = max(int(blocked.min()) - 1, 0) / (len(attempt.nodes) - 1)
            first = first or error
            needed[blocked] += TILT_STEP
        if needed.max() > config.largest_tilt + 1e-9:
            raise first


class _Attempt:
    """One path, to be resolved with more and more tilt."""

    def __init__(
        self,
        positions_B: np.ndarray,
        normals_B: np.ndarray,
        period: float,
        limits: Limits,
        along: bool,
        q_before: np.ndarray | None,
    ) -> None:
        self._positions_B, self._normals_B = positions_B, normals_B
        self._mean_normal_B = normals_B.mean(axis=0)
        self._along, self._q_before = along, q_before
        self._is_free = limits.config.roll_tolerance >= FREE_ROLL
        self._limits = limits
        self._s = probe_poses.lengths(positions_B)
        self.nodes = probe_poses.nodes(self._s)
        self._durations = np.diff(self.nodes) * period

    def resolution(self, needed: np.ndarray) -> RedundancyResolution:
        """With the tilt that the nodes need at least [rad].

        Raises:
            BlockedError: There is none.
        """
        tilt = _spline(_enveloped(needed))
        axes_B = self._normals_B
        if needed.max() > 0.0:
            fraction = self._s / self._s[-1]
            axes_B = probe_poses.tilted(axes_B, self._mean_normal_B, tilt(fraction))
        X_BQ = _without_roll(
            self._positions_B, axes_B, self._mean_normal_B, self._is_free, self._along
        )
        candidates = Candidates(X_BQ[self.nodes], self._limits.stricter, self._q_before)
        rolls, branch = _clear_motion(candidates, self._durations)
        smooth, fault = self._smoothed(X_BQ, candidates.allowed[..., branch], rolls, branch)
        if smooth is None:
            raise BlockedError(
                f"{candidates.where(fault[0])} is {fault[1]} once the roll is smooth", fault[0]
            )
        return RedundancyResolution(
            roll=smooth,
            tilt=tilt,
            branch=branch,
            mean_normal_B=self._mean_normal_B,
            is_free=self._is_free,
            along=self._along,
        )

    def _smoothed(
        self, X_BQ: np.ndarray, allowed: np.ndarray, rolls: np.ndarray, branch: int
    ) -> tuple[BSpline | None, tuple[int, str]]:
        """The smoothest roll that keeps every limit; else where it breaks which."""
        within = _corridor(allowed, rolls)
        between = np.linspace(0, len(self.nodes) - 1, BETWEEN * (len(self.nodes) - 1) + 1)
        samples = np.interp(between, np.arange(len(self.nodes)), self.nodes).round().astype(int)
        fault = (0, "")
        for width in SMOOTHING_WIDTHS:
            roll = _spline(_smooth_rolls(rolls, *within, width))
            X_BP = rolled(X_BQ[samples], roll(self._s[samples] / self._s[-1]))
            faults = self._limits.faults(X_BP, branch)
            broken = [k for k, what in enumerate(faults) if what]
            if not broken:
                return roll, fault
            fault = (round(between[broken[0]]), faults[broken[0]])
        return None, fault


def _without_roll(
    positions_B: np.ndarray,
    normals_B: np.ndarray,
    mean_normal_B: np.ndarray,
    is_free: bool,
    along: bool,
) -> np.ndarray:
    if is_free:
        return probe_poses.steady_poses(positions_B, normals_B, mean_normal_B)
    return probe_poses.on_path_poses(positions_B, normals_B, along=along)


def _clear_motion(candidates: Candidates, durations: np.ndarray) -> tuple[np.ndarray, int]:
    """Rolls and branch of minimum motion whose every pose keeps all limits.

    Some limits are looked at only along the minimum motion; a pose that breaks one there is looked
    at for all its candidates, and the minimum motion is sought again.
    """
    while True:
        candidates.require_open()
        graph = RollGraph(
            q=candidates.q, cost=candidates.cost, durations=durations, largest_step=LARGEST_STEP
        )
        rolls, branch = graph.minimum_motion()
        index = np.round(rolls / ROLL_STEP).astype(int) % ROLLS
        if candidates.look_closer(index, branch):
            return rolls, branch


def _enveloped(needed: np.ndarray) -> np.ndarray:
    """A smooth tilt along the nodes that is nowhere less than needed [rad]."""
    wide = maximum_filter1d(needed, 2 * TILT_REACH + 1, mode="nearest")
    return gaussian_filter1d(wide, TILT_REACH / 4.0, truncate=3.0, mode="nearest")


def _corridor(
    allowed: Bool[np.ndarray, "n 72"], rolls: Float[np.ndarray, "n"]
) -> tuple[np.ndarray, np.ndarray]:
    """How far each pose's roll may go to either side with no barred one in between [rad]."""
    index = np.round(rolls / ROLL_STEP).astype(int)
    return (
        rolls - ROLL_STEP * _open_steps(allowed, index, -1),
        rolls + ROLL_STEP * _open_steps(allowed, index, 1),
    )


def _open_steps(
    allowed: Bool[np.ndarray, "n 72"], index: Int[np.ndarray, "n"], direction: int
) -> Int[np.ndarray, "n"]:
    steps = direction * np.arange(1, ROLLS // 2)
    beside = np.take_along_axis(allowed, (index[:, None] + steps) % ROLLS, axis=1)
    return np.cumprod(beside, axis=1).sum(axis=1)


def _smooth_rolls(rolls: np.ndarray, low: np.ndarray, high: np.ndarray, width: float) -> np.ndarray:
    """The rolls averaged over `width` poses, and brought back where they leave the corridor."""
    vertices = gaussian_filter1d(rolls, width, mode="nearest")
    for _ in range(SMOOTHING_ROUNDS):
        within = np.clip(vertices, low, high)
        if np.array_equal(within, vertices):
            break
        vertices = gaussian_filter1d(within, SMOOTHING_WIDTHS[-1], mode="nearest")
    return vertices


def _spline(values: np.ndarray) -> BSpline:
    """A cubic B-spline over the fraction of the length that goes along values at the nodes: twice
    differentiable, and within their range, and so within the roll's or the tilt's tolerance.
    """
    nodes = np.linspace(0.0, 1.0, len(values))
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, len(values) - 2), np.ones(3)])
    places = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0  # each control vertex's own
    return BSpline(knots, np.interp(places, nodes, values), 3)
