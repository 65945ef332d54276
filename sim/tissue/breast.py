"""The breast's classes: proportions by VICTRE's closed form, laid down for a patient on her back.

VICTRE's breast phantom is a superellipsoid with half axes scale a1^e1 (head to foot), scale a2^e1
(across) and scale a3^e1 (outwards), by class of density [VICTRE]. Two things change here. Lying
down, the breast keeps its volume but spreads: the height falls to `SUPINE_ASPECT` mean radii and
the base grows. And the superellipse's profile, whose curvature is infinite at the tip, gives way to
a smooth one of equal volume (`BreastShape.roundness`).
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.special import beta

VICTRE_SCALE = 0.035
"""Length of a1 = a2 = a3 = 1 [m]."""
SUPINE_ASPECT = 0.055 / 0.075
"""Height over mean radius of a breast that lies on the chest [-]: that of the standard breast."""

BreastClass = Literal["standard", "dense", "heterogeneous", "scattered", "fatty"]


@dataclass(frozen=True, kw_only=True)
class BreastShape:
    """Numbers of one breast before any variation; lengths in m. x points to the feet, y away
    from the sternum.
    """

    radius: float
    """Mean radius of the base [m]."""
    height: float
    """Height of the nipple's tip above the chest plate [m]."""
    roundness: float
    """Bulge of the flanks [-]: 0 is a paraboloid, (height / radius)^2 a cap of a sphere, 1 half an
    ellipsoid, whose rim stands upright on the chest. Lying on the back, a breast runs out into the
    chest."""
    elongation: float
    """Half the relative difference of the base's width (y) and length (x) [-]."""
    quadrants: tuple[float, float] = (0.05, 0.03)
    """Relative surplus of the lower (x) and of the outer (y) half over the mean radius [-]."""
    ptosis: tuple[float, float] = (0.05, 1.0)
    """Sag towards the feet: linear [-] and quadratic [1/m] in the height: a quarter of VICTRE's,
    which stands."""
    turn: tuple[float, float] = (0.03, 0.5)
    """Lean away from the sternum: linear [-] and quadratic [1/m] in the height."""
    nipple_height: float = 0.003
    """Rise of the nipple above the areola [m]."""
    nipple_radius: float = 0.008
    """Radius at which the nipple has fallen to 1/e [m]."""
    areola_height: float = 0.001
    """Rise of the areola above the breast [m]."""
    areola_radius: float = 0.016
    """Radius of the areola [m]."""


def supine(a1: float, a2: float, a3: float, e1: float) -> BreastShape:
    """VICTRE's breast with these coefficients, laid on its back at the same volume."""
    length, width, projection = VICTRE_SCALE * np.array([a1, a2, a3]) ** e1
    bulk = beta(e1 / 2, e1 + 1) * e1 / 2  # volume over that of the cylinder around it
    volume = np.pi * length * width * projection * bulk
    elongation = float((width - length) / (width + length))
    bumps = BreastShape.nipple_height + BreastShape.areola_height
    radius = np.roots([SUPINE_ASPECT, -bumps, 0.0, -volume / (np.pi * (1 - elongation**2) * bulk)])[
        0
    ].real
    return BreastShape(
        radius=float(radius),
        height=float(SUPINE_ASPECT * radius),
        roundness=float(6 * bulk - 3),
        elongation=elongation,
    )


SHAPES: dict[BreastClass, BreastShape] = {
    "standard": BreastShape(radius=0.075, height=0.055, roundness=0.5, elongation=0.03),
    "dense": supine(1.0, 1.0, 1.0, 1.2),
    "heterogeneous": supine(1.2, 1.0, 1.55, 1.2),
    "scattered": supine(1.4, 1.2, 2.0, 1.2),
    "fatty": supine(1.4, 1.4, 2.75, 1.1),
}
"""The standard breast comes near the paper's loop, which is 118 mm by 147 mm across at half
height."""

assert set(SHAPES) == set(get_args(BreastClass))
