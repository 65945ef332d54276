"""Poses of the probe along a path: its axis against the normals, its roll counted from a frame that
goes along.
"""

import math

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from breastscan.errors import PlanningError
from breastscan.geometry import se3

NODE_SPACING = 0.005
"""Distance of the path's nodes [m], the poses on which choices are made."""
MIN_STEPS = 6
"""Steps from node to node on the shortest path: a quintic curve needs so many."""
MIN_SINE = 0.01
"""Minimum sine of the angle between the direction of travel and the normal."""
MIN_COSINE = -0.9
"""Minimum cosine of the angle between a normal and the mean of all: the shortest rotation to the
opposite is not defined."""


def on_path_poses(
    positions_B: Float[np.ndarray, "n 3"], normals_B: Float[np.ndarray, "n 3"], *, along: bool
) -> Float[np.ndarray, "n 4 4"]:
    """Probe poses at roll 0: z against the normal, x (the array) across the direction of travel, or
    along it.

    The direction is that of a quintic curve through some of the samples. The path's own tangent has
    a kink in its rate of rotation at every point of a cubic, which would be an unbounded jerk of
    the joints.
    """
    s = lengths(positions_B)
    chosen = nodes(s)
    travel_B = make_interp_spline(s[chosen], positions_B[chosen], 5).derivative()(s)
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
    if along:
        x_B = np.cross(z_B, x_B)
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


def tilted(
    normals_B: Float[np.ndarray, "n 3"],
    mean_normal_B: Float[np.ndarray, "3"],
    tilt: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "n 3"]:
    """The normals rotated by `tilt` [rad] towards the mean of all: the probe's handle comes up, off
    the chest. Where a normal is nearer to the mean than that, it becomes it.
    """
    up_B = mean_normal_B / np.linalg.norm(mean_normal_B)
    cosine = normals_B @ up_B
    across_B = up_B - cosine[:, None] * normals_B
    sine = np.linalg.norm(across_B, axis=1)
    angle = np.minimum(tilt, np.arctan2(sine, cosine))[:, None]
    across_B = across_B / np.maximum(sine, np.finfo(float).tiny)[:, None]
    turned_B = np.cos(angle) * normals_B + np.sin(angle) * across_B
    return turned_B / np.linalg.norm(turned_B, axis=1, keepdims=True)


def retreated(X_BP: Float[np.ndarray, "*n 4 4"], distance: float) -> Float[np.ndarray, "*n 4 4"]:
    """The poses `distance` [m] back along their own axis."""
    X_retreated = X_BP.copy()
    X_retreated[..., :3, 3] -= distance * X_BP[..., :3, 2]
    return X_retreated


def lengths(positions_B: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Length of the path up to each sample [m], which must grow.

    Raises:
        PlanningError: It does not, or there are too few samples.
    """
    steps = np.linalg.norm(np.diff(positions_B, axis=0), axis=1)
    if len(steps) < MIN_STEPS or not steps.min() > 0.0:
        bad = int(np.argmin(steps)) if len(steps) else 0
        raise PlanningError(
            f"the path stands still at sample {bad + 1} of {len(positions_B)}, or has fewer than "
            f"{MIN_STEPS + 1} samples: drop repeated samples",
            bad,
        )
    return np.append(0.0, np.cumsum(steps))


def nodes(s: Float[np.ndarray, "n"]) -> np.ndarray:
    """Indices of samples about `NODE_SPACING` apart in length `s` [m], both ends among them."""
    count = max(math.ceil(s[-1] / NODE_SPACING), MIN_STEPS)
    found = np.unique(np.searchsorted(s, np.linspace(0.0, s[-1], count + 1)))
    return np.append(found[:-1], len(s) - 1)
