"""What the breast is made of: fat, a glandular core, a stiff mass, and the skin as a membrane.

All stiffnesses are ratios to the fat's Young's modulus, so that the elasticity is computed once for
every modulus. The skin is .75 mm thin and many times as stiff as what lies under it: no solid
element could resolve it, so it enters as a membrane, which resists stretching in its plane and has
no stiffness against bending.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError

FAT_YOUNG = 5e3
GLAND_YOUNG = 15e3
MASS_YOUNG = 20e3
"""Young's moduli of the digital phantom [Pa] [VICTRE]."""
SKIN_YOUNG = 344e3
"""Young's modulus of breast skin by suction, 195 to 480 kPa [Pa] [Sutradhar]."""
SKIN_THICKNESS = 0.75e-3
"""[m] [VICTRE]"""
TRANSITION = 0.003
"""Width over which one tissue passes into another [m]."""


@dataclass(frozen=True, kw_only=True)
class LayerConfig:
    """Tissues inside the breast; the default is one homogeneous tissue without skin."""

    gland_fraction: float = 0.0
    """Size of the glandular core over the breast's, both around the centre of the base [-]; 0 for
    none."""
    gland_ratio: float = GLAND_YOUNG / FAT_YOUNG
    """Young's modulus of gland over fat's [-]."""
    skin_ratio: float = 0.0
    """Young's modulus of the skin over fat's [-]; 0 leaves the skin out, 69 is measured skin over
    fat."""
    mass_radius: float = 0.0
    """Radius of a stiff round mass [m]; 0 for none."""
    mass_p_S: tuple[float, float, float] = (0.03, 0.0, 0.025)
    """Its centre in the phantom [m]."""
    mass_ratio: float = MASS_YOUNG / FAT_YOUNG
    """Young's modulus of the mass over fat's [-]."""

    def __post_init__(self) -> None:
        for name in ("gland_ratio", "mass_ratio"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(
                    f"{name} must be positive: no tissue has a stiffness of {getattr(self, name)}",
                    self,
                )
        for name in ("skin_ratio", "mass_radius"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)}", self)
        if not 0 <= self.gland_fraction < 1:
            raise ConfigError(
                f"gland_fraction must lie in [0, 1), got {self.gland_fraction}: fat surrounds the "
                "gland",
                self,
            )
        if len(self.mass_p_S) != 3 or not np.isfinite(self.mass_p_S).all():
            raise ConfigError(
                f"mass_p_S must be three finite lengths in metres, got {self.mass_p_S}", self
            )

    @property
    def present(self) -> bool:
        """Whether there is anything but one homogeneous tissue."""
        return self.gland_fraction > 0 or self.mass_radius > 0 or self.skin_ratio > 0


def modulus_ratio(
    config: LayerConfig,
    ball: Float[np.ndarray, "*n 3"],
    p_S: Float[np.ndarray, "*n 3"],
    radius: float,
) -> Float[np.ndarray, "*n"]:
    """Young's modulus over the fat's at points given on the half-ball and in S [m], in a breast
    of `radius` [m].
    """
    ratio = np.ones(ball.shape[:-1])
    if config.gland_fraction > 0:
        inside = _step((config.gland_fraction - np.linalg.norm(ball, axis=-1)) * radius)
        ratio += inside * (config.gland_ratio - ratio)
    if config.mass_radius > 0:
        inside = _step(
            config.mass_radius - np.linalg.norm(p_S - np.array(config.mass_p_S), axis=-1)
        )
        ratio += inside * (config.mass_ratio - ratio)
    return ratio


def _step(depth: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """0 outside to 1 inside, a smooth step across a boundary `depth` [m] inwards from it."""
    t = np.clip(depth / TRANSITION + 0.5, 0.0, 1.0)
    return t * t * (3 - 2 * t)
