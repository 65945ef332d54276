"""What can be chosen of the phantom: class and size, variation, looks, mechanics."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from breastscan.checks import require_positive, require_seed
from breastscan.errors import ConfigError
from sim.tissue.breast import SHAPES, BreastClass
from sim.tissue.layers import LayerConfig

Texture = Literal["skin", "speckle", "smooth", "plastic"]
Mechanics = Literal["soft", "printed", "flex"]
OWN_RANGE = ("ptosis", "asymmetry", "gel_friction", "poisson", "seed", "texture_seed", "layers")
"""Settings that are not all positive numbers."""


@dataclass(frozen=True, kw_only=True)
class PhantomConfig:
    """Shape, looks and mechanics of the phantom."""

    breast: BreastClass = "standard"
    """Class of the shape: "standard", or one of VICTRE's four by density."""
    size: float = 1.0
    """All lengths of the shape over the class's own [-]."""
    projection: float = 1.0
    """Height over radius, against the class's own [-]."""
    ptosis: float = 1.0
    """Sag towards the feet over the class's own [-]."""
    asymmetry: float = 1.0
    """Differences between the quadrants, and lean away from the sternum, over the class's own
    [-]."""
    seed: int | None = None
    """Draws the small variation of the shape; None follows the seed of the whole."""
    texture: Texture = "skin"
    """Natural skin, the sprayed dots of digital image correlation, skin with hardly any texture, or
    printed plastic."""
    texture_seed: int | None = None
    """Draws the texture; None follows the seed of the shape."""
    mechanics: Mechanics = "soft"
    """Soft tissue by finite elements, a rigid print, or MuJoCo's own deformable solid."""
    young: float = 30e3
    """Young's modulus of the tissue, of the fat where it has layers [Pa]."""
    poisson: float = 0.45
    """Poisson's ratio [-], below .5: the finite elements cannot represent an incompressible
    solid."""
    layers: LayerConfig = field(default_factory=LayerConfig)
    gel_friction: float = 0.1
    """Friction coefficient of the gel between probe and skin [-]; .05 to .2 are plausible."""

    def __post_init__(self) -> None:
        for name, known in (
            ("breast", SHAPES),
            ("texture", get_args(Texture)),
            ("mechanics", get_args(Mechanics)),
        ):
            if getattr(self, name) not in known:
                raise ConfigError(
                    f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}", self
                )
        require_positive(self, "phantom", but=OWN_RANGE)
        require_seed(self.texture_seed, "phantom.texture_seed")
        for name in ("ptosis", "asymmetry", "gel_friction"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ConfigError(
                    f"{name} must not be negative, got {getattr(self, name)}", getattr(self, name)
                )
        if not 0 <= self.poisson < 0.5:
            raise ConfigError(
                f"poisson must lie in [0, .5), got {self.poisson}: use .45 for soft tissue",
                self.poisson,
            )
