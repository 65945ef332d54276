"""Joint path: probe positions and normals become a joint trajectory inside every limit [Zhang, Sec. V-B.1, Fig. 19].

Spin and branch are chosen once for the whole path (`planning.route`); here the inverse kinematics is solved at every
control period, on that branch.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import route
from breastscan.planning.joint_limits import Clearances, check_trajectory
from breastscan.planning.joint_limits import JointPathConfig as JointPathConfig
from breastscan.planning.route import Route


@dataclass(frozen=True, kw_only=True)
class JointPath:
    """Joint angles for every sample of the path, and for the poses clear of the skin before and after it."""

    q: Float[np.ndarray, "n 6"]
    """Joint angles [rad]."""
    qd: Float[np.ndarray, "n 6"]
    """Joint speeds [rad/s]."""
    q_approach: Float[np.ndarray, "6"]
    """The first pose, retreated along the normal, on the same branch [rad]."""
    q_retreat: Float[np.ndarray, "6"]
    """The last pose, retreated likewise [rad]."""
    spin: Float[np.ndarray, "n"]
    """Turn about the probe's axis [rad]: from where the array lies across the path if `spin_tolerance` binds it, else
    from the mean pose."""


def plan(
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    config: JointPathConfig,
    clearances: Clearances | None = None,
) -> JointPath:
    """Joint trajectory that carries the probe tip along the path with its axis against the normals.

    The timing is taken as it is; `planning.motion` slows it down where a limit asks for it.

    Args:
        positions_B: Probe tip at every control period, in B [m].
        normals_B: Outward unit normals of the skin there.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        config: Limits, margins and the freedom of the spin.
        clearances: Measures the arm's distance from itself and its surroundings; None leaves that out.

    Raises:
        PlanningError: Some point cannot be reached, or no path joins the reachable poses inside every limit.
    """
    chosen = route.choose(positions_B, normals_B, X_FP, period, config, clearances)
    path = follow(chosen, positions_B, normals_B, X_FP, period, config)
    check_trajectory(path.q, period, config, clearances)
    return path


def follow(
    chosen: Route,
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    X_FP: Float[np.ndarray, "4 4"],
    period: float,
    config: JointPathConfig,
    calibration: KinematicCalibration | None = None,
) -> JointPath:
    """The joint trajectory along a chosen route, its limits unchecked; see `plan` for the arguments.

    Args:
        chosen: Spin and branch.
        positions_B: Probe tip at every control period, in B [m].
        normals_B: Outward unit normals of the skin there.
        X_FP: Probe tip in the flange.
        period: Control period [s].
        config: Where the approach starts.
        calibration: The arm's own kinematics; None for the nominal arm's.

    Raises:
        PlanningError: The branch ends somewhere on the path.
    """
    X_BP, spin = chosen.poses(positions_B, normals_B)
    ends = route.retreated(X_BP[[0, -1]], config.clearance)
    X_BF = np.concatenate([ends[:1], X_BP, ends[1:]]) @ se3.inverse(X_FP)
    q = _follow_branch(X_BF, chosen.branch, calibration)
    return JointPath(q=q[1:-1], qd=np.gradient(q[1:-1], period, axis=0), q_approach=q[0], q_retreat=q[-1], spin=spin)


def _follow_branch(X_BF: np.ndarray, branch: int, calibration: KinematicCalibration | None) -> np.ndarray:
    """Joint angles of one branch along the poses: no jumps of whole turns, and each joint's range about zero."""
    q = kinematics.inverse_branches(X_BF)[:, branch]
    if calibration is not None:
        q = calibration.refined(q, X_BF)
    lost = np.isnan(q[:, 0])
    if lost.any():
        bad = int(np.argmax(lost))
        raise PlanningError(
            f"the arm loses its configuration at sample {bad} of {len(q)}: raise joints.singularity_margin, or move "
            "the phantom",
            bad,
        )
    q = np.unwrap(q, axis=0)
    middle = (q.min(axis=0) + q.max(axis=0)) / 2.0
    return q - 2.0 * np.pi * np.round(middle / (2.0 * np.pi))
