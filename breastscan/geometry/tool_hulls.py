"""The hulls of a tool of which only the tip is known: a probe of usual size along the tip's axis,
and a bar from the flange to where that axis comes nearest to the flange's.
"""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from breastscan.geometry.hulls import Shape

HALF_WIDTH, HALF_THICKNESS = 0.028, 0.013
"""Of the probe's handle, along and across its array [m]: a hand-held convex probe."""
FACE = 0.01
"""How far behind its face it begins [m]: what touches does not count."""
CLAMP = 0.01
"""How far before the bar it ends [m]."""
BAR = 0.041
"""Radius of the bar, and where it begins over the flange [m]: that of a wrist sensor, less where
the tip is nearer."""
PARALLEL = 1e-6
"""Square of the sine of the angle between axes that have no nearest place [-]."""


def tool_hulls(X_FP: Float[np.ndarray, "4 4"]) -> tuple[Shape, Shape]:
    """Probe and bar in F, of a tip at `X_FP` that lies before the flange."""
    tip_F, axis_F = X_FP[:3, 3], X_FP[:3, 2]
    radius = float(np.clip((np.linalg.norm(tip_F) - FACE) / 2, PARALLEL, BAR))
    start_F = np.array([0.0, 0.0, radius])
    sine2 = float(axis_F[:2] @ axis_F[:2])
    if sine2 > PARALLEL:
        length = float(tip_F[:2] @ axis_F[:2]) / sine2
    else:
        length = float((tip_F - start_F) @ axis_F)
    length = max(length, 2 * (FACE + CLAMP))
    half = (length - FACE - CLAMP) / 2
    X_PH = se3.pose(np.eye(3), np.array([0.0, 0.0, -FACE - half]))
    probe = Shape(
        name="probe_of_tip", kind="box", size=(HALF_WIDTH, HALF_THICKNESS, half), X=X_FP @ X_PH
    )
    along_F = tip_F - length * axis_F - start_F
    reach = max(float(np.linalg.norm(along_F)), PARALLEL)
    axes = se3.axes_along(along_F / reach) if reach > PARALLEL else np.eye(3)
    X_FH = se3.pose(axes.T, start_F + along_F / 2)
    bar = Shape(name="bar_to_tip", kind="capsule", size=(radius, reach / 2), X=X_FH)
    return probe, bar
