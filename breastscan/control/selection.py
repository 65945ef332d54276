"""Which directions the plan controls and which the force: S and S' of [Zhang, Fig. 23].

In the probe's frame S' selects the probe axis; S = 1 - S' all the rest. The expected pose X_e is S
of the planned one, moved across the axis as breath and drag ask (`control.across`), with the probe
turned about its tip as far as the wrench asks, and S' of what the force controller makes of the
force error. That acts along the planned axis, so that a probe that turns does not leave the planned
line.
"""

import math
from typing import no_type_check

import numba


@numba.njit(cache=True)
@no_type_check
def moved_across(X_BP, shift_B):
    """The planned pose, moved across its axis.

    Args:
        X_BP: Planned pose of the tip, (4, 4) [m].
        shift_B: Of which what lies along the axis is left out, (3,) [m].
    """
    along = shift_B[0] * X_BP[0, 2] + shift_B[1] * X_BP[1, 2] + shift_B[2] * X_BP[2, 2]
    X_moved = X_BP.copy()
    for i in range(3):
        X_moved[i, 3] += shift_B[i] - along * X_BP[i, 2]
    return X_moved


@numba.njit(cache=True)
@no_type_check
def corrected(X_BP, depth, rx, ry):
    """The pose that is sent.

    Args:
        X_BP: Planned pose of the tip, (4, 4) [m].
        depth: Along the planned axis [m].
        rx: Rotation of the probe about its own x, with the tip in place [rad].
        ry: The same about its y then [rad].
    """
    cx = math.cos(rx)
    sx = math.sin(rx)
    cy = math.cos(ry)
    sy = math.sin(ry)
    X_sent = X_BP.copy()
    for i in range(3):
        x = X_BP[i, 0]
        y = X_BP[i, 1]
        z = X_BP[i, 2]
        across = cx * z - sx * y
        X_sent[i, 0] = cy * x - sy * across
        X_sent[i, 1] = cx * y + sx * z
        X_sent[i, 2] = sy * x + cy * across
        X_sent[i, 3] += depth * z
    return X_sent
