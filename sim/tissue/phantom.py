"""The breast phantom's undeformed shape and its looks.

The shape follows the closed form of VICTRE's breast phantom (quadrants, ptosis, turn; see
REFERENCES.md), flattened for a patient who lies on her back. Its pieces are chosen so that the map
from the unit half-ball to the phantom is smooth and has a closed inverse: the skin is the image of
the unit hemisphere, and `Phantom.level` is an exact implicit function of it. In S, x points to the
patient's feet and y away from the sternum. On a curved chest the whole is sheared along z.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, UInt8

from breastscan.errors import ConfigError
from sim.tissue import dome, texture
from sim.tissue.breast import SHAPES
from sim.tissue.chest import heights_over
from sim.tissue.hemisphere import hemisphere, sphere_axes
from sim.tissue.phantom_config import PhantomConfig

SHAPE_VARIATION = 0.1
"""Relative standard deviation of the asymmetry between two seeds."""
STEEPEST_QUADRANT = 0.4
"""Largest surplus of one half of the base over the mean radius [-]."""
FARTHEST_LEAN = 0.6
"""Farthest shift of the nipple over the base's radius [-]."""
FLATTEST = 0.25
"""Largest fraction of the height that nipple and areola may take [-]."""
SKIN_RINGS = 72
"""Rings of the fine skin mesh: 1.4 mm edges, so that its facets stay within .01 mm of the smooth
surface (.04 mm on the nipple)."""
TEXTURE_SIZE_PX = 2048
TEXTURE_RIM = 0.49
"""Distance from the centre of the texture at which the base of the breast lies [image widths]."""
PLATE_SIDE = 0.4
"""Side of the square that `Phantom.plate_texture` covers [m]."""
BISECTIONS = 60
"""Halvings that find a contour to the last bit."""
TOP_REACH, TOP_TOLERANCE = 0.4, 1e-6
"""Half width of the square around the hemisphere's pole in which the breast's top is sought, and
that at which the search ends [-]."""
TOP_GRID = 17
"""Points along the square's side."""


@dataclass(frozen=True, kw_only=True)
class SkinMesh:
    """A fine triangulation of the undeformed skin; its border lies on the chest."""

    vertices_S: Float[np.ndarray, "n 3"]
    """Points of the smooth surface [m]."""
    triangles: Int[np.ndarray, "m 3"]
    """Vertex indices, counter-clockwise seen from outside."""
    uv: Float[np.ndarray, "n 2"]
    """Texture coordinates: u along the image's columns, v down its rows, both in [0, 1]."""
    normals_S: Float[np.ndarray, "n 3"]
    """Outward unit normals of the smooth surface."""


class Phantom:
    """The undeformed breast: a smooth surface over the chest plate, its fine mesh and its
    textures.
    """

    def __init__(self, config: PhantomConfig, curvature: float = 0.0) -> None:
        """Draw the shape.

        Args:
            config: What can be chosen of it.
            curvature: Of the chest across the body's long axis [1/m]; 0 for a flat one.

        Raises:
            ConfigError: The skin would fold into itself, the breast hang beside its base, or its
                mass lie outside.
        """
        shape = SHAPES[config.breast]
        self.config = config
        self.radius = config.size * shape.radius
        """Mean radius of the base [m]."""
        height = config.size * config.projection * shape.height
        self.areola_radius = config.size * shape.areola_radius
        """Radius of the areola [m]."""
        self.curvature = curvature
        """Of the chest across the body's long axis [1/m]."""
        self.parameters = np.append(_draw(config, self.radius, height), curvature)
        """The map's coefficients, for `dome`."""
        self.height = height if curvature == 0 else self._top_height()
        """Height of the breast's top, the nipple's tip, above the chest [m]."""
        mass_p_S = np.array(config.layers.mass_p_S)
        if config.layers.mass_radius > 0 and not (
            self.level(mass_p_S[None])[0] < 0 <= self.heights(mass_p_S)
        ):
            raise ConfigError(
                f"the stiff mass at mass_p_S = {config.layers.mass_p_S} m lies outside of the "
                f"breast, which is {self.height * 1e3:.0f} mm high and has a radius of "
                f"{self.radius * 1e3:.0f} mm: move it inwards",
                config.layers.mass_p_S,
            )

    def embed(self, ball: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the unit half-ball z >= 0 mapped into the phantom, in S [m]; |ball| = 1 is
        the skin.
        """
        return dome.embed(self.parameters, np.ascontiguousarray(ball).reshape(-1, 3)).reshape(
            ball.shape
        )

    def inverse_map(self, p_S: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Inverse of `embed`, extended smoothly around the phantom."""
        return dome.inverse_map(self.parameters, np.ascontiguousarray(p_S).reshape(-1, 3)).reshape(
            p_S.shape
        )

    def level(self, p_S: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Implicit function of the skin: negative inside, zero on it, positive outside [-]."""
        return np.linalg.norm(self.inverse_map(p_S), axis=-1) - 1

    def heights(self, p_S: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Heights above the chest, along its normal [m]."""
        flat = np.ascontiguousarray(p_S).reshape(-1, 3)
        return heights_over(self.curvature, flat).reshape(p_S.shape[:-1])

    def normal(self, direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Outward unit normal in S of the skin at `direction`, a point of the unit hemisphere."""
        along, across = self.tangents(direction)
        normal = np.cross(along, across)
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def tangents(self, direction: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `embed` [m] along the two axes of `sphere_axes` at `direction` (central
        differences).
        """
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
        plan = direction[:, :2] / np.maximum(
            np.linalg.norm(direction[:, :2], axis=1, keepdims=True), 1e-12
        )
        return SkinMesh(
            vertices_S=self.embed(direction),
            triangles=triangles,
            uv=0.5 + TEXTURE_RIM * (polar / (np.pi / 2))[:, None] * plan,
            normals_S=self.normal(direction),
        )

    def level_loop(self, height: float, count: int) -> Float[np.ndarray, "n 3"]:
        """Contour of the skin at `height` above the chest, along its normal: `count` points in S
        [m], running about z.

        Raises:
            ValueError: The height is not between the chest plate and the nipple's tip.
        """
        if not 0 <= height < self.height:
            raise ValueError(
                f"the skin has no contour at {height} m: give a height in [0, {self.height}) m"
            )
        azimuth = np.linspace(0, 2 * np.pi, count, endpoint=False)
        around = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1)
        low, high = np.zeros((count, 1)), np.ones((count, 1))
        for _ in range(BISECTIONS):
            midpoint = (low + high) / 2
            below = self.heights(self.embed(_meridian(around, midpoint)))[:, None] < height
            low, high = np.where(below, midpoint, low), np.where(below, high, midpoint)
        return self.embed(_meridian(around, low))

    def texture_image(self) -> UInt8[np.ndarray, "t t 3"]:
        """Colours of the skin for `SkinMesh.uv`, RGB."""
        pixel = self._meridian / (TEXTURE_RIM * TEXTURE_SIZE_PX)
        rng = np.random.default_rng(self._texture_seed)
        return self._looks(rng, TEXTURE_SIZE_PX, pixel, self.areola_radius)

    def plate_texture(self) -> UInt8[np.ndarray, "t t 3"]:
        """Colours of the chest plate around the breast, RGB, `PLATE_SIDE` wide; it can be tiled."""
        size = TEXTURE_SIZE_PX // 2
        rng = np.random.default_rng([self._texture_seed, 1])
        return self._looks(rng, size, PLATE_SIDE / size, 0.0)

    @property
    def _texture_seed(self) -> int:
        own, shape = self.config.texture_seed, self.config.seed
        return (shape or 0) if own is None else own

    def _looks(
        self, rng: np.random.Generator, size: int, pixel: float, areola_radius: float
    ) -> UInt8[np.ndarray, "t t 3"]:
        if self.config.texture == "speckle":
            return texture.speckle(rng, size, pixel)
        if self.config.texture == "plastic":
            return texture.plastic(rng, size, pixel)
        if self.config.texture == "smooth":
            return texture.smooth(rng, size, pixel, areola_radius)
        return texture.skin(rng, size, pixel, areola_radius)

    @property
    def _meridian(self) -> float:
        """Length of the skin from nipple to base [m], the mean over the azimuth."""
        rings = self.embed(
            hemisphere(SKIN_RINGS)[0][[3 * k * (k + 1) for k in range(SKIN_RINGS + 1)]]
        )
        return float(np.linalg.norm(np.diff(rings, axis=0), axis=1).sum())

    def _top_height(self) -> float:
        """Height of the highest point, near the pole, on ever finer grids."""
        steps = np.linspace(-1.0, 1.0, TOP_GRID)
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        best, reach = np.zeros(2), TOP_REACH
        height = 0.0
        while reach > TOP_TOLERANCE:
            xy = best + reach * grid
            ball = np.column_stack([xy, np.sqrt(1 - np.sum(xy**2, axis=1))])
            heights = self.heights(self.embed(ball))
            best, height = xy[heights.argmax()], float(heights.max())
            reach *= 4 / TOP_GRID
        return height


def _meridian(
    around: Float[np.ndarray, "n 3"], cosine: Float[np.ndarray, "n 1"]
) -> Float[np.ndarray, "n 3"]:
    """Directions of the unit hemisphere over horizontal ones, by their z."""
    return np.sqrt(1 - cosine**2) * around + cosine * [0.0, 0.0, 1.0]


def _draw(config: PhantomConfig, radius: float, height: float) -> Float[np.ndarray, "15"]:
    """The map's coefficients, as `dome` takes them, after the seed's variation."""
    shape = SHAPES[config.breast]
    rng = np.random.default_rng(config.seed or 0)
    vary = 1 + SHAPE_VARIATION * rng.standard_normal(7)
    radii = radius * (1 + shape.elongation * vary[0] * np.array([-1.0, 1.0]))
    quadrants = config.asymmetry * np.array(shape.quadrants) * vary[1:3]
    strength = np.array([config.ptosis, config.asymmetry])
    lean = np.array([shape.ptosis, shape.turn]).T * strength * vary[3:].reshape(2, 2)
    lean[1] /= config.size
    bumps = config.size * np.array([shape.nipple_height, shape.areola_height])
    widths = np.array([shape.nipple_radius, shape.areola_radius]) / shape.radius
    _check(config, radius, height, quadrants, lean, float(bumps.sum()))
    return np.array(
        [
            *radii,
            *quadrants,
            *lean.ravel(),
            height - bumps.sum(),
            height,
            shape.roundness,
            *bumps,
            *widths,
        ]
    )


def _check(
    config: PhantomConfig,
    radius: float,
    height: float,
    quadrants: Float[np.ndarray, "2"],
    lean: Float[np.ndarray, "2 2"],
    bump: float,
) -> None:
    """Refuse a map that folds, or that leans too far to be seen and touched from above."""
    if np.abs(quadrants).max() > STEEPEST_QUADRANT:
        raise ConfigError(
            f"asymmetry {config.asymmetry} makes one half of the breast wider than the other by "
            f"{np.abs(quadrants).max():.2f}, and from .5 on the skin folds into itself: use a "
            "smaller one",
            config.asymmetry,
        )
    shift = np.linalg.norm(lean[0] * height + lean[1] * height**2)
    if shift > FARTHEST_LEAN * radius:
        raise ConfigError(
            f"ptosis {config.ptosis} and asymmetry {config.asymmetry} move the nipple by "
            f"{shift / radius:.2f} radii, beside the base: at most {FARTHEST_LEAN} can be seen and "
            "touched from above, use smaller ones",
            config.ptosis,
        )
    if bump > FLATTEST * height:
        raise ConfigError(
            f"projection {config.projection} leaves a breast {height * 1e3:.0f} mm high, too flat "
            f"for a nipple and areola that rise by {bump * 1e3:.0f} mm: use a larger one",
            config.projection,
        )
