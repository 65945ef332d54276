"""The paper's own fifteen points as a path with normals, which the paper does not print [Zhang,
Table 4].

The points lie 0.5 to 7.8 mm above the base plane of the paper's robot, at half the height of its
breast. The lower half of the breast, and what it lay on, were therefore below that plane: the table
is put `TABLE_HEIGHT` below it, where the twin's chest plate, 80 mm thick, carries a breast whose
half height is at the points.
"""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import kinematics, se3
from breastscan.planning.joint_limits import VIOLATIONS, JointPathConfig, violations
from breastscan.planning.pattern import Path
from breastscan.planning.roll_graph import ROLL_STEP, ROLLS, rolled
from breastscan.report.paper import TABLE4_THEORETICAL_MM

POINTS_B: Float[np.ndarray, "15 3"] = TABLE4_THEORETICAL_MM * 1e-3
"""The planned points in the base frame of the paper's robot [m]."""
TABLE_HEIGHT = -0.105
"""Top of the table in that frame [m]."""
LINK_RADIUS = 0.05
"""Half a link above the table, as `JointPathConfig.floor` has it [m]."""
HEIGHT_FRACTION = 55.0 / 75.0
"""Height of the dome as a fraction of its base's radius: the twin's breast."""


def vertical() -> Path:
    """The points with vertical normals: the probe upright throughout."""
    return Path(points_B=POINTS_B, normals_B=np.tile([0.0, 0.0, 1.0], (len(POINTS_B), 1)))


def dome() -> Path:
    """The points with the normals of a dome fitted to them.

    An ellipse is fitted to the points in their own plane; it is the section at half height of half
    an ellipsoid that is as steep as the twin's breast. There its gradient along the section is 3/2
    M (x - c), for the ellipse (x - c)' M (x - c) = 1, and 1 / h upwards.
    """
    centre_B = POINTS_B.mean(axis=0)
    _, _, axes_B = np.linalg.svd(POINTS_B - centre_B)
    axes_B[2] *= np.sign(axes_B[2, 2])
    in_plane = (POINTS_B - centre_B) @ axes_B[:2].T
    M, centre = _ellipse(in_plane)
    height = HEIGHT_FRACTION * np.sqrt(4.0 / 3.0) * np.linalg.det(M) ** -0.25
    outwards = 1.5 * (in_plane - centre) @ M
    gradient_B = outwards @ axes_B[:2] + axes_B[2] / height
    return Path(
        points_B=POINTS_B, normals_B=gradient_B / np.linalg.norm(gradient_B, axis=1, keepdims=True)
    )


def unreachable(path: Path, X_FP: Float[np.ndarray, "4 4"], config: JointPathConfig) -> list[str]:
    """The points of a path that no roll and no branch reaches, each with what it violates."""
    X_BQ = _across_path(path)
    rolls = ROLL_STEP * np.arange(ROLLS)
    across = np.abs(np.angle(np.exp(2j * rolls))) / 2.0
    rolls = rolls[across <= config.roll_tolerance + 1e-9]
    X_BP = rolled(
        np.repeat(X_BQ[:, None], len(rolls), axis=1),
        np.broadcast_to(rolls, (len(X_BQ), len(rolls))),
    )
    X_BF = X_BP @ se3.inverse(X_FP)
    against = violations(kinematics.inverse_branches(X_BF), config)
    excess_mm = kinematics.reach_excess(X_BF).min(axis=1) * 1e3
    lost = []
    for point in np.flatnonzero(against.any(axis=0).reshape(len(X_BF), -1).all(axis=1)):
        counts = against[1:, point].sum(axis=(1, 2))
        reason = (
            f"{excess_mm[point]:.0f} mm out of reach"
            if excess_mm[point] > 0
            else VIOLATIONS[1 + counts.argmax()]
        )
        lost.append(f"P{point + 1} ({reason})")
    return lost


def _across_path(path: Path) -> Float[np.ndarray, "n 4 4"]:
    """The probe's poses at the points, with the array across the curve."""
    travel_B = path.curve.evaluate(path.curve.breaks[: len(path.points_B)], 1)
    z_B = -path.normals_B
    x_B = np.cross(travel_B, z_B)
    x_B /= np.linalg.norm(x_B, axis=1, keepdims=True)
    return se3.pose(np.stack([x_B, np.cross(z_B, x_B), z_B], axis=-1), path.points_B)


def _ellipse(
    p: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, "2"]]:
    """Matrix M [1/m^2] and centre c [m] of the ellipse (x - c)' M (x - c) = 1 nearest to the
    points.
    """
    x, y = p.T
    a, b, c, d, e = np.linalg.lstsq(
        np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(len(p)), rcond=None
    )[0]
    M = np.array([[a, b / 2.0], [b / 2.0, c]])
    centre = -np.linalg.solve(2.0 * M, np.array([d, e]))
    return M / (1.0 + centre @ M @ centre), centre
