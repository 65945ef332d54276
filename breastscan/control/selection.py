"""Which directions the plan controls and which the force: S and S' of [Zhang, Fig. 23].

In the probe's frame S' selects the probe axis; S = 1 - S' all the rest. The expected pose X_e is S of the planned one,
with the probe turned about its tip as far as the wrench asks, and S' of what the force controller makes of the force
error. That acts along the planned axis, so that a probe that turns does not leave the planned line.
"""

import math

import numpy as np
from jaxtyping import Float


def corrected(X_BP: Float[np.ndarray, "4 4"], depth: float, turn: tuple[float, float]) -> Float[np.ndarray, "4 4"]:
    """The pose that is sent.

    Args:
        X_BP: Planned pose of the tip.
        depth: Along the planned axis [m].
        turn: Of the probe about its own x and y, with the tip in place [rad].
    """
    (cx, sx), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in turn)
    R_turn = np.array([[cy, 0.0, sy], [sx * sy, cx, -sx * cy], [-cx * sy, sx, cx * cy]])
    X_sent = X_BP.copy()
    X_sent[:3, :3] = X_BP[:3, :3] @ R_turn
    X_sent[:3, 3] += depth * X_BP[:3, 2]
    return X_sent
