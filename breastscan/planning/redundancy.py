"""Redundancy resolution: the roll of the probe about its axis along a path and the branch of the
inverse kinematics on which the arm follows, for the minimum joint motion over all of it.

The probe may roll about its own axis, and the arm reaches a pose on up to eight branches. The
choice is made on poses some millimetres apart (`planning.roll_graph`); its rolls are then smoothed.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.planning.joint_limits import (
    VIOLATIONS,
    Clearances,
    JointPathConfig,
    elbow_down,
    violations,
)
from breastscan.planning.roll_graph import ROLL_STEP, ROLLS, RollGraph, rolled

GRAPH_SPACING = 0.005
"""Distance of the graph's poses along the path [m]."""
MIN_STEPS = 6
"""Steps of the graph on the shortest path: a quintic curve needs so many."""
SMOOTHING_POSES = 3.0
"""Width (standard deviation) of the average that takes the graph's steps out of the roll, in poses
of the graph."""
MIN_SINE = 0.01
"""Minimum sine of the angle between the direction of travel and the normal."""
MIN_COSINE = -0.9
"""Minimum cosine of the angle between a normal and the mean of all: the shortest rotation to the
opposite is not defined."""
FREE_ROLL = math.pi / 2 - 1e-9
"""Roll tolerance from which on every roll is allowed [rad]."""
FLOOR_MARGIN = 0.005
"""Added to the minimum height for the graph's poses [m], so that the smoothed roll does not dip
below it."""
LARGEST_STEP = 0.6
"""Joint change from pose to pose above which the arm would flip [rad]."""
ELBOW_DOWN_COST = 1e3
"""Added at each pose with the elbow down, in the graph's unit of rad^2/s: any path with the elbow
up costs less."""


@dataclass(frozen=True, kw_only=True)
class RedundancyResolution:
    """The roll and the branch chosen for a path, independent of its timing."""

    roll: BSpline
    """Roll of the probe about its axis [rad], over the fraction of the path's length."""
    branch: int
    """Index into `kinematics.inverse_branches`."""
    mean_normal_B: Float[np.ndarray, "3"] | None
    """A free roll is measured from the `steady_poses` about it; None where the roll is measured
    from across the path."""

    def poses(
        self, positions_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 4 4"]:
        """Probe poses X_BP along the path."""
        s = _lengths(positions_B)
        return rolled(
            _poses_without_roll(positions_B, normals_B, self.mean_normal_B), self.roll(s / s[-1])
        )


def resolve(
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    config: JointPathConfig,
    clearances: Clearances | None = None,
) -> RedundancyResolution:
    """The roll and branch of minimum joint motion that violate no limit and keep clear of the cell.

    Args:
        positions_B: Probe tip at every control period, in B [m].
        normals_B: Outward unit normals of the skin there.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        config: Limits, margins and the freedom of the roll.
        clearances: Measures the arm's distance from itself and its surroundings; None leaves that
            out.

    Raises:
        PlanningError: Some point cannot be reached, or no joint path joins the reachable poses.
    """
    mean_normal_B = normals_B.mean(axis=0) if config.roll_tolerance >= FREE_ROLL else None
    X_BQ = _poses_without_roll(positions_B, normals_B, mean_normal_B)
    nodes = _graph_poses(_lengths(positions_B))
    graph = _graph(X_BQ[nodes], se3.inverse(X_FP), np.diff(nodes) * period, config)
    rolls, branch = _clear_motion(graph, clearances, config.collision_margin)
    return RedundancyResolution(
        roll=_smooth_roll(rolls), branch=branch, mean_normal_B=mean_normal_B
    )


def across_path_poses(
    positions_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 4 4"]:
    """Probe poses at roll 0: z against the normal, x (the array) across the direction of travel.

    The direction is that of a quintic curve through some of the samples. The path's own tangent has
    a kink in its rate of rotation at every point of a cubic, which would be an unbounded jerk of
    the joints.
    """
    s = _lengths(positions_B)
    nodes = _graph_poses(s)
    travel_B = make_interp_spline(s[nodes], positions_B[nodes], 5).derivative()(s)
    z_B = -normals_B
    x_B = np.cross(travel_B, z_B)
    across = np.linalg.norm(x_B, axis=1)
    if not across.min() > MIN_SINE:
        bad = int(np.argmin(across))
        raise PlanningError(
            f"the path runs along the normal at sample {bad} of {len(positions_B)}: its direction "
            "of travel across the skin is not defined there, so check the normals",
            positions_B[bad],
        )
    x_B /= across[:, None]
    return se3.pose(np.stack([x_B, np.cross(z_B, x_B), z_B], axis=-1), positions_B)


def steady_poses(
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    mean_normal_B: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 4 4"]:
    """Probe poses at roll 0 whatever the direction of travel: the mean pose, by the shortest
    rotation to each normal.

    A free roll is measured from here, so that the smoothed roll need not undo every wiggle of the
    path.
    """
    R_mean = Rotation.align_vectors(-mean_normal_B[None], np.array([[0.0, 0.0, 1.0]]))[
        0
    ].as_matrix()
    axis_B = np.cross(R_mean[:, 2], -normals_B)
    cosine = -normals_B @ R_mean[:, 2]
    if not cosine.min() > MIN_COSINE:
        bad = int(np.argmin(cosine))
        raise PlanningError(
            f"the normal at sample {bad} of {len(normals_B)} points against the others: check the "
            "normals",
            normals_B[bad],
        )
    W = np.cross(axis_B[:, None, :], np.eye(3)[None]).swapaxes(1, 2)  # W v = axis x v
    rotation = np.eye(3) + W + W @ W / (1.0 + cosine)[:, None, None]
    return se3.pose(rotation @ R_mean, positions_B)


def retreated(X_BP: Float[np.ndarray, "*n 4 4"], distance: float) -> Float[np.ndarray, "*n 4 4"]:
    """The poses `distance` [m] back along their own axis."""
    X_retreated = X_BP.copy()
    X_retreated[..., :3, 3] -= distance * X_BP[..., :3, 2]
    return X_retreated


def _poses_without_roll(
    positions_B: np.ndarray, normals_B: np.ndarray, mean_normal_B: np.ndarray | None
) -> np.ndarray:
    if mean_normal_B is None:
        return across_path_poses(positions_B, normals_B)
    return steady_poses(positions_B, normals_B, mean_normal_B)


def _lengths(positions_B: np.ndarray) -> np.ndarray:
    """Length of the path up to each sample [m], which must grow."""
    steps = np.linalg.norm(np.diff(positions_B, axis=0), axis=1)
    if len(steps) < MIN_STEPS or not steps.min() > 0.0:
        bad = int(np.argmin(steps)) if len(steps) else 0
        raise PlanningError(
            f"the path stands still at sample {bad + 1} of {len(positions_B)}, or has fewer than "
            f"{MIN_STEPS + 1} samples: drop repeated samples",
            bad,
        )
    return np.append(0.0, np.cumsum(steps))


def _graph_poses(s: np.ndarray) -> np.ndarray:
    """Indices of samples about `GRAPH_SPACING` apart in length `s` [m], both ends among them."""
    count = max(math.ceil(s[-1] / GRAPH_SPACING), MIN_STEPS)
    nodes = np.unique(np.searchsorted(s, np.linspace(0.0, s[-1], count + 1)))
    return np.append(nodes[:-1], len(s) - 1)


def _graph(
    X_BQ: np.ndarray, X_PF: np.ndarray, durations: np.ndarray, config: JointPathConfig
) -> RollGraph:
    """All rolls and branches of the poses, and what it costs to be there."""
    rolls = ROLL_STEP * np.arange(ROLLS)
    X_BP = rolled(
        np.repeat(X_BQ[:, None], ROLLS, axis=1), np.broadcast_to(rolls, (len(X_BQ), ROLLS))
    )
    q = kinematics.inverse_branches(X_BP @ X_PF)
    strict = replace(config, floor=config.floor + FLOOR_MARGIN)
    against = violations(q, strict)
    ends = [0, -1]  # from here the probe must come clear of the skin too
    q_clear = kinematics.inverse_branches(retreated(X_BP[ends], config.clearance) @ X_PF)
    against[:, ends] |= violations(q_clear, strict)
    # half a rotation leaves the array across the path
    across = np.abs(np.angle(np.exp(2j * rolls))) / 2.0
    beyond_tolerance = (across > config.roll_tolerance + 1e-9)[:, None]
    allowed = ~(against.any(axis=0) | beyond_tolerance)
    _check_reachable(X_BP, X_PF, against, allowed)
    cost = np.where(allowed, ELBOW_DOWN_COST * elbow_down(q), np.inf)
    return RollGraph(q=q, cost=cost, durations=durations, largest_step=LARGEST_STEP)


def _check_reachable(
    X_BP: np.ndarray, X_PF: np.ndarray, against: np.ndarray, allowed: np.ndarray
) -> None:
    """Every pose must have an allowed node; else name the worst one and the limits that it
    violates.
    """
    barred = ~allowed.any(axis=(1, 2))
    if not barred.any():
        return
    excess = np.where(barred, kinematics.reach_excess(X_BP @ X_PF).min(axis=1), -1.0)
    worst = int(np.argmax(excess))
    point_mm = np.round(X_BP[worst, 0, :3, 3] * 1e3)
    where = f"point {worst + 1} of {len(X_BP)} along the path, at {point_mm} mm in B,"
    if excess[worst] > 0.0:
        raise PlanningError(
            f"{where} is {excess[worst] * 1e3:.0f} mm out of the arm's reach: move the phantom "
            "that much, or tilt the probe's mount",
            worst,
        )
    counts = ", ".join(
        f"{int(o.sum())} {name}" for name, o in zip(VIOLATIONS, against[:, worst], strict=True)
    )
    raise PlanningError(
        f"{where} has no allowed joint angles; of {allowed[worst].size} candidates, there or just "
        f"clear of the skin, {counts}, and the rest have the wrong roll: free the roll, tilt the "
        "probe's mount or move the phantom",
        worst,
    )


def _clear_motion(
    graph: RollGraph, clearances: Clearances | None, margin: float
) -> tuple[np.ndarray, int]:
    """Rolls and branch of minimum motion whose every pose keeps `margin` [m] from collisions.

    Distances are measured only along the minimum motion; a pose where it would collide is
    measured for all its nodes, these are barred, and the minimum motion is sought again.
    """
    while True:
        rolls, branch = graph.minimum_motion()
        if clearances is None:
            return rolls, branch
        index = np.round(rolls / ROLL_STEP).astype(int) % ROLLS
        colliding = np.flatnonzero(
            clearances(graph.q[np.arange(len(graph.q)), index, branch]) < margin
        )
        if len(colliding) == 0:
            return rolls, branch
        for pose in colliding:
            open_nodes = np.isfinite(graph.cost[pose])
            near = clearances(graph.q[pose][open_nodes]) < margin
            graph.cost[pose][open_nodes] = np.where(near, np.inf, graph.cost[pose][open_nodes])
            if near.all():
                raise PlanningError(
                    f"at pose {pose} of {len(graph.q)} along the path the arm comes within "
                    f"{margin * 1e3:.0f} mm of itself or its surroundings whatever the roll: move "
                    "the phantom, tilt the probe's mount or lower joints.collision_margin",
                    int(pose),
                )


def _smooth_roll(node_rolls: np.ndarray) -> BSpline:
    """Roll over the fraction of the length: a cubic B-spline whose control vertices are the
    averaged rolls of the graph.

    It is twice differentiable and stays within the range of its vertices, and so within the roll's
    tolerance.
    """
    vertices = gaussian_filter1d(node_rolls, SMOOTHING_POSES, mode="nearest")
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, len(vertices) - 2), np.ones(3)])
    return BSpline(knots, vertices, 3)
