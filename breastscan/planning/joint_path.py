"""Joint path: probe positions and normals become a joint trajectory inside every limit [Zhang, Sec.
V-B.1, Fig. 19].

Roll and branch are chosen once for the whole path (`planning.redundancy`); here the inverse
kinematics is solved at every control period, on that branch.
"""

import numpy as np
from jaxtyping import Float

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.kinematic_calibration import KinematicCalibration
from breastscan.planning import probe_poses
from breastscan.planning.redundancy import RedundancyResolution


def follow(
    chosen: RedundancyResolution,
    positions_B: Float[np.ndarray, "n 3"],
    normals_B: Float[np.ndarray, "n 3"],
    X_FP: Float[np.ndarray, "4 4"],
    clearance: float,
    calibration: KinematicCalibration | None = None,
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "6"]]:
    """Joint angles that carry the probe tip along a chosen route, its axis against the normals.

    The timing is taken as it is, and limits are not checked: `planning.motion` does both.

    Args:
        chosen: Roll and branch.
        positions_B: Probe tip at every control period, in B [m].
        normals_B: Outward unit normals of the skin there.
        X_FP: Probe tip in the flange.
        clearance: How far before the first and after the last pose lie along the normal [m].
        calibration: The arm's own kinematics; None for the nominal arm's.

    Returns:
        Joint angles at every period, and those clear of the skin before the first, all on the same
        branch [rad].

    Raises:
        PlanningError: The branch ends somewhere on the path, or before or after it.
    """
    X_BP = chosen.poses(positions_B, normals_B)
    before, after = probe_poses.retreated(X_BP[[0, -1]], clearance)
    X_BF = np.concatenate([before[None], X_BP, after[None]]) @ se3.inverse(X_FP)
    q = kinematics.inverse_branches(X_BF)[:, chosen.branch]
    if calibration is not None:
        q = calibration.refined(q, X_BF)
    lost = np.isnan(q[:, 0])
    if lost.any():
        bad = int(np.argmax(lost))
        where = {0: "clear of the skin before the path", len(q) - 1: "clear of it after the path"}
        raise PlanningError(
            f"{where.get(bad, f'at sample {bad} of {len(positions_B)} of the path')} the arm "
            "cannot go on with its joints bent as before: a singularity lies there",
            bad,
        )
    q = np.unwrap(q, axis=0)  # no jumps of full rotations, and each joint's range about zero
    centre = (q.min(axis=0) + q.max(axis=0)) / 2.0
    q -= 2.0 * np.pi * np.round(centre / (2.0 * np.pi))
    return q[1:-1], q[0]
