"""How far numbers scatter, most of which are normal and some of which are anything."""

import numpy as np
from jaxtyping import Float

NORMAL_DEVIATIONS = 1.4826
"""Standard deviations of a normal distribution in its median absolute value [-]."""


def deviation(residual: Float[np.ndarray, "n"]) -> float:
    """Standard deviation about zero of most of the residuals, in their unit."""
    return NORMAL_DEVIATIONS * float(np.median(np.abs(residual)))
