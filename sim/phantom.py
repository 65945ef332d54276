"""The breast phantom's undeformed shape and its looks.

The shape follows the closed form of VICTRE's breast phantom (quadrants, ptosis, turn; see REFERENCES.md), flattened
for a patient who lies on her back. Its pieces are chosen so that the map from the unit half-ball to the phantom is
smooth and has a closed inverse: the skin is the image of the unit hemisphere, and `Phantom.level` is an exact implicit
function of it. In S, x points to the patient's feet and y away from the sternum.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from breastscan.errors import ConfigError
from sim import texture
from sim.hemisphere import hemisphere, sphere_axes

SHAPE_VARIATION = 0.1
"""Relative standard deviation of the asymmetry between two seeds."""
SKIN_RINGS = 72
"""Rings of the fine skin mesh: 1.4 mm edges, so that its facets stay within .01 mm of the smooth surface (.04 mm on
the nipple)."""
TEXTURE_SIZE_PX = 2048
TEXTURE_RIM = 0.49
"""Distance from the middle of the texture at which the base of the breast lies [image widths]."""
PLATE_SIDE = 0.4
"""Side of the square that `Phantom.plate_texture` covers [m]."""


@dataclass(frozen=True, kw_only=True)
class PhantomConfig:
    """Size, asymmetry, looks and elasticity of the phantom."""

    radius: float = 0.075
    """Mean radius of the base [m]."""
    height: float = 0.055
    """Height of the nipple's tip above the chest plate [m]."""
    roundness: float = 0.5
    """Bulge of the flanks [-]: 0 is a paraboloid, (height / radius)^2 a cap of a sphere, 1 half an ellipsoid, whose rim
    stands upright on the chest. Lying on the back, a breast runs out into the chest."""
    elongation: float = 0.03
    """Half the relative difference of the base's width (y) and length (x) [-]."""
    quadrants: tuple[float, float] = (0.05, 0.03)
    """Relative surplus of the lower (x) and of the outer (y) half over the mean radius [-]."""
    ptosis: tuple[float, float] = (0.05, 1.0)
    """Sag towards the feet: linear [-] and quadratic [1/m] in the height."""
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
    seed: int = 0
    """Draws the small variation of the shape, and the texture."""
    texture: Literal["skin", "speckle"] = "skin"
    """Natural skin, or the sprayed dots of digital image correlation."""
    young: float = 30e3
    """Young's modulus [Pa]."""
    poisson: float = 0.45
    """Poisson's ratio [-], below .5: the finite elements cannot represent an incompressible solid."""

    def __post_init__(self) -> None:
        for name in ("radius", "height", "nipple_radius", "areola_radius", "young"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}", getattr(self, name))
        if not 0 <= self.poisson < 0.5:
            raise ConfigError(f"poisson must lie in [0, .5), got {self.poisson}: use .45 for soft tissue", self.poisson)
        if not 0 <= self.nipple_height + self.areola_height < self.height / 2:
            bump = self.nipple_height + self.areola_height
            raise ConfigError(f"nipple and areola must rise by less than half of {self.height} m, got {bump} m", bump)
        if not 0 <= self.roundness <= 1:
            raise ConfigError(f"roundness must lie in 0 .. 1, got {self.roundness}", self.roundness)
        if max(abs(self.elongation), *map(abs, self.quadrants)) > 0.3:
            raise ConfigError("elongation and quadrants must stay within +-.3: beyond, the skin folds", self.quadrants)
        if self.texture not in ("skin", "speckle"):
            raise ConfigError(f'texture must be "skin" or "speckle", got {self.texture!r}', self.texture)


@dataclass(frozen=True, kw_only=True)
class SkinMesh:
    """A fine triangulation of the undeformed skin; its border lies in the plane z_S = 0."""

    vertices_S: Float[np.ndarray, "n 3"]
    """Points of the smooth surface [m]."""
    triangles: Int[np.ndarray, "m 3"]
    """Vertex indices, counter-clockwise seen from outside."""
    uv: Float[np.ndarray, "n 2"]
    """Texture coordinates: u along the image's columns, v down its rows, both in [0, 1]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals of the smooth surface."""


@dataclass(frozen=True)
class _Shape:
    """The map's coefficients after the seed's variation; lengths in m."""

    radii: Float[np.ndarray, "2"]
    quadrants: Float[np.ndarray, "2"]
    lean: Float[np.ndarray, "2 2"]
    """Rows: linear and quadratic in z; columns: along x and y."""
    dome_height: float
    bump_heights: Float[np.ndarray, "2"]
    bump_widths: Float[np.ndarray, "2"]
    """Widths of nipple and areola on the unit half-ball [-]."""


class Phantom:
    """The undeformed breast: a smooth surface over the chest plate, its fine mesh and its textures."""

    def __init__(self, config: PhantomConfig) -> None:
        self.config = config
        self._shape = _draw_shape(config)

    def embed(self, ball: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the unit half-ball z >= 0 mapped into the phantom, in S [m]; |ball| = 1 is the skin."""
        shape = self._shape
        xy = ball[..., :2]
        z = ball[..., 2:]
        height = shape.dome_height * z + self._bump(xy) * z**2
        plan = shape.radii * xy * (1 + shape.quadrants * xy) * self._flank(height) + self._lean(height)
        return np.concatenate([plan, height], axis=-1)

    def unembed(self, p_S: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Inverse of `embed`, extended smoothly around the phantom."""
        shape = self._shape
        height = p_S[..., 2:]
        plan = (p_S[..., :2] - self._lean(height)) / (shape.radii * self._flank(height))
        xy = _quadratic_root(plan, 1.0, shape.quadrants)
        z = _quadratic_root(height, shape.dome_height, self._bump(xy))
        return np.concatenate([xy, z], axis=-1)

    def level(self, p_S: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Implicit function of the skin: negative inside, zero on it, positive outside [-]."""
        return np.linalg.norm(self.unembed(p_S), axis=-1) - 1

    def normal(self, direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Outward unit normal in S of the skin at `direction`, a point of the unit hemisphere."""
        along, across = self.tangents(direction)
        normal = np.cross(along, across)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def tangents(self, direction: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `embed` [m] along the two axes of `sphere_axes` at `direction` (central differences)."""
        step = 1e-5
        along, across = (
            (self.embed(direction + step * axis) - self.embed(direction - step * axis)) / (2 * step)
            for axis in sphere_axes(direction)
        )
        return along, across

    @cached_property
    def skin(self) -> SkinMesh:
        """The fine mesh of the skin."""
        direction, triangles = hemisphere(SKIN_RINGS)
        polar = np.arccos(np.clip(direction[:, 2], -1, 1))
        plan = direction[:, :2] / np.maximum(np.linalg.norm(direction[:, :2], axis=1, keepdims=True), 1e-12)
        return SkinMesh(
            vertices_S=self.embed(direction),
            triangles=triangles,
            uv=0.5 + TEXTURE_RIM * (polar / (np.pi / 2))[:, None] * plan,
            normals_S=self.normal(direction),
        )

    def level_loop(self, height: float, count: int) -> Float[np.ndarray, "n 3"]:
        """Contour of the skin at `height` above the chest plate: `count` points in S [m], turning about z.

        Raises:
            ValueError: The height is not between the chest plate and the nipple's tip.
        """
        if not 0 <= height < self.config.height:
            raise ValueError(f"the skin has no contour at {height} m: give a height in [0, {self.config.height}) m")
        cosine = self._cosine_at(height)
        azimuth = np.linspace(0, 2 * np.pi, count, endpoint=False)
        sine = np.sqrt(1 - cosine**2)
        direction = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.full(count, cosine)], axis=1)
        return self.embed(direction)

    def texture_image(self) -> UInt8[np.ndarray, "t t 3"]:
        """Colours of the skin for `SkinMesh.uv`, RGB."""
        pixel = self._meridian / (TEXTURE_RIM * TEXTURE_SIZE_PX)
        rng = np.random.default_rng(self.config.seed)
        if self.config.texture == "speckle":
            return texture.speckle(rng, TEXTURE_SIZE_PX, pixel)
        return texture.skin(rng, TEXTURE_SIZE_PX, pixel, self.config.areola_radius)

    def plate_texture(self) -> UInt8[np.ndarray, "t t 3"]:
        """Colours of the chest plate around the breast, RGB, `PLATE_SIDE` wide; it can be tiled."""
        size = TEXTURE_SIZE_PX // 2
        rng = np.random.default_rng([self.config.seed, 1])
        if self.config.texture == "speckle":
            return texture.speckle(rng, size, PLATE_SIDE / size)
        return texture.skin(rng, size, PLATE_SIDE / size)

    @property
    def _meridian(self) -> float:
        """Length of the skin from nipple to base [m], the mean over the azimuth."""
        rings = self.embed(hemisphere(SKIN_RINGS)[0][[3 * k * (k + 1) for k in range(SKIN_RINGS + 1)]])
        return float(np.linalg.norm(np.diff(rings, axis=0), axis=1).sum())

    def _cosine_at(self, height: float) -> float:
        """The contour at `height` on the unit hemisphere: its z, by bisection (the height rises with z)."""
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            point = np.array([np.sqrt(1 - middle**2), 0.0, middle])
            low, high = (middle, high) if self.embed(point)[2] < height else (low, middle)
        return low

    def _bump(self, xy: np.ndarray) -> np.ndarray:
        """Rise of nipple and areola [m] over a point of the half-ball's base disc."""
        radius_squared = (xy**2).sum(axis=-1, keepdims=True)
        bumps = self._shape.bump_heights * np.exp(-radius_squared / self._shape.bump_widths**2)
        return bumps.sum(axis=-1, keepdims=True)

    def _flank(self, height: np.ndarray) -> np.ndarray:
        """Radius of a level over the half-ellipsoid's [-]: (1 - t)(1 + k t) in place of (1 - t)(1 + t), rooted."""
        t = np.maximum(height / self.config.height, -0.5)  # anything smooth will do below the chest plate
        return np.sqrt((1 + self.config.roundness * t) / (1 + t))

    def _lean(self, height: np.ndarray) -> np.ndarray:
        """Ptosis and turn: the shift of a level in x and y [m]."""
        return self._shape.lean[0] * height + self._shape.lean[1] * height**2


def _quadratic_root(value: np.ndarray, linear: float, square: np.ndarray) -> np.ndarray:
    """The root t next to 0 of `linear t + square t^2 = value`, where `square` may vanish."""
    discriminant = np.maximum(linear**2 + 4 * square * value, 0)
    return 2 * value / (linear + np.sqrt(discriminant))


def _draw_shape(config: PhantomConfig) -> _Shape:
    rng = np.random.default_rng(config.seed)
    vary = 1 + SHAPE_VARIATION * rng.standard_normal(7)
    bump_heights = np.array([config.nipple_height, config.areola_height])
    return _Shape(
        radii=config.radius * (1 + config.elongation * vary[0] * np.array([-1.0, 1.0])),
        quadrants=np.array(config.quadrants) * vary[1:3],
        lean=np.array([config.ptosis, config.turn]).T * vary[3:].reshape(2, 2),
        dome_height=config.height - float(bump_heights.sum()),
        bump_heights=bump_heights,
        bump_widths=np.array([config.nipple_radius, config.areola_radius]) / config.radius,
    )
