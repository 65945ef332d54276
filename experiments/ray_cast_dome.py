"""An exact stereo pair of a breast-like dome, cast ray by ray without a renderer: ground truth for
the vision code.

A spherical cap stands on a flat chest plate above a table. The cameras are ideal, rectified
pinholes that look straight down on it. All three surfaces carry one texture, laid out along arc
length so that it is not stretched.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from breastscan.vision.camera import RectifiedPair

TEXTURE_PITCH = 0.2e-3
"""Edge of a texture cell [m]."""
TEXTURE_CELLS = 2048
FINEST_GRAIN, COARSEST_GRAIN = 0.7e-3, 4e-3
"""Standard deviations of the blurs that bound the speckle's size [m]."""
FINEST_PORE, LARGEST_PATCH = 0.5e-3, 10e-3
"""Bounds of the sizes on skin [m], as blur and as inverse angular frequency."""
SKIN_DECAY = 1.2
"""Power of the frequency with which the contrast of skin falls off."""


@dataclass(frozen=True, kw_only=True)
class DomeScene:
    """The dome, the plate, the table and the rig; lengths in L."""

    focal_px: float = 684.7
    baseline: float = 0.09898
    """Distance of the optical centres [m]."""
    width_px: int = 640
    height_px: int = 448
    plate_distance: float = 0.565
    """Depth of the chest plate [m]; the dome's mean depth is then about 540 mm."""
    dome_radius: float = 0.075
    """Radius of the dome's base [m]."""
    dome_height: float = 0.055
    """Height of the dome's apex over the plate [m]."""
    plate_size: tuple[float, float] = (0.26, 0.32)
    """Sides of the plate along x and y [m]."""
    table_drop: float = 0.1
    """Depth of the table below the plate [m]."""
    brightness: float = 130.0
    """Mean grey level of a face that looks at the camera."""
    contrast: float = 0.12
    """Standard deviation of the texture over its mean."""
    texture: Literal["speckle", "skin"] = "speckle"
    """Grains of one size, or of all sizes as on skin."""
    samples: int = 3
    """Rays a pixel, along each axis."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Principal point (x, y) of both views [px]."""
        return (self.width_px - 1) / 2, (self.height_px - 1) / 2

    @property
    def sphere_radius(self) -> float:
        """Radius of the sphere that the dome is cut from [m]."""
        return (self.dome_radius**2 + self.dome_height**2) / (2 * self.dome_height)

    @property
    def sphere_centre(self) -> Float[np.ndarray, "3"]:
        """Centre of that sphere in L [m]; the dome stands midway between the cameras."""
        return np.array(
            [self.baseline / 2, 0.0, self.plate_distance - self.dome_height + self.sphere_radius]
        )

    @cached_property
    def points(self) -> Float[np.ndarray, "h w 3"]:
        """The surface point in L that each left pixel's centre sees [m]."""
        return self._cast(np.zeros(3), self._directions(0.0, 0.0))

    @property
    def disparity(self) -> Float[np.ndarray, "h w"]:
        """True disparity of each left pixel [px]."""
        return self.focal_px * self.baseline / self.points[..., 2]

    @property
    def on_dome(self) -> Bool[np.ndarray, "h w"]:
        """Left pixels that see the dome."""
        return self.points[..., 2] < self.plate_distance - 1e-9

    @property
    def seen_twice(self) -> Bool[np.ndarray, "h w"]:
        """Left pixels whose surface point the right camera sees too, unhidden and inside its
        image.
        """
        right_centre = np.array([self.baseline, 0.0, 0.0])
        rays = self.points - right_centre
        hits = self._cast(right_centre, rays / rays[..., 2:])
        columns = np.arange(self.width_px) - self.disparity
        return (np.abs(hits - self.points).max(axis=-1) < 1e-6) & (columns >= 0)

    def pair(self, *, noise: float = 1.0, seed: int = 0) -> RectifiedPair:
        """Both views with normal noise of standard deviation `noise` [grey levels], rounded to 8
        bit.
        """
        rng = np.random.default_rng(seed)
        left, right = (
            _quantised(view + noise * rng.standard_normal(view.shape))
            for view in (self._left_view, self._right_view)
        )
        return RectifiedPair(
            left=left,
            right=right,
            focal_px=self.focal_px,
            centre_px=self.centre_px,
            baseline=self.baseline,
            R_LV=np.eye(3),
        )

    @cached_property
    def _left_view(self) -> Float[np.ndarray, "h w"]:
        return self._view(np.zeros(3))

    @cached_property
    def _right_view(self) -> Float[np.ndarray, "h w"]:
        return self._view(np.array([self.baseline, 0.0, 0.0]))

    def _view(self, eye: Float[np.ndarray, "3"]) -> Float[np.ndarray, "h w"]:
        """Grey levels without noise: the mean over `samples` squared rays a pixel."""
        steps = (np.arange(self.samples) + 0.5) / self.samples - 0.5
        texture = grains(TEXTURE_SPECTRA[self.texture], seed=3)
        view = np.zeros((self.height_px, self.width_px))
        for dy in steps:
            for dx in steps:
                view += self._grey(self._cast(eye, self._directions(dx, dy)), texture)
        return view / self.samples**2

    def _directions(self, dx: float, dy: float) -> Float[np.ndarray, "h w 3"]:
        """Rays with unit z through the points (dx, dy) [px] off every pixel's centre."""
        x = (np.arange(self.width_px) + dx - self.centre_px[0]) / self.focal_px
        y = (np.arange(self.height_px) + dy - self.centre_px[1]) / self.focal_px
        return np.stack(np.broadcast_arrays(x, y[:, None], 1.0), axis=-1)

    def _cast(
        self, eye: Float[np.ndarray, "3"], rays: Float[np.ndarray, "h w 3"]
    ) -> Float[np.ndarray, "h w 3"]:
        """First surface point in L along each ray [m]."""
        to_centre = self.sphere_centre - eye
        along = rays @ to_centre
        squared = np.sum(rays * rays, axis=-1)
        inside = along**2 - squared * (to_centre @ to_centre - self.sphere_radius**2)
        depth = (along - np.sqrt(np.maximum(inside, 0.0))) / squared
        on_plate = eye + self.plate_distance * rays
        offset = np.abs(on_plate[..., :2] - self.sphere_centre[:2])
        beyond = np.where(
            np.all(offset <= np.array(self.plate_size) / 2, axis=-1), 0.0, self.table_drop
        )
        hits_dome = (inside > 0.0) & (depth < self.plate_distance)
        return eye + rays * np.where(hits_dome, depth, self.plate_distance + beyond)[..., None]

    def _grey(
        self, points: Float[np.ndarray, "h w 3"], texture: Float[np.ndarray, "n n"]
    ) -> Float[np.ndarray, "h w"]:
        """Grey level of surface points under a lamp beside the camera."""
        from_axis = points[..., :2] - self.sphere_centre[:2]
        radius = np.hypot(from_axis[..., 0], from_axis[..., 1])
        sine = np.minimum(radius, self.dome_radius) / self.sphere_radius
        arc = self.sphere_radius * np.arcsin(sine) + np.maximum(radius - self.dome_radius, 0.0)
        cells = (
            from_axis * (arc / np.maximum(radius, 1e-12) / TEXTURE_PITCH)[..., None]
            + TEXTURE_CELLS / 2
        )
        u, v = np.moveaxis(cells.astype(np.float32), -1, 0)
        grain = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        dome = points[..., 2] < self.plate_distance - 1e-9
        facing = np.where(dome, np.sqrt(1 - sine**2), 1.0)
        return self.brightness * (0.4 + 0.6 * facing) * (1 + self.contrast * grain)


def _speckle_spectrum(frequency: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    return np.exp(-0.5 * (frequency * FINEST_GRAIN) ** 2) - np.exp(
        -0.5 * (frequency * COARSEST_GRAIN) ** 2
    )


def _skin_spectrum(frequency: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    pores = np.exp(-0.5 * (frequency * FINEST_PORE) ** 2)
    return pores / (frequency + 1 / LARGEST_PATCH) ** SKIN_DECAY


TEXTURE_SPECTRA = {"speckle": _speckle_spectrum, "skin": _skin_spectrum}
"""Amplitude against angular frequency [rad/m]."""


def grains(
    spectrum: Callable[[Float[np.ndarray, "n m"]], Float[np.ndarray, "n m"]], seed: int
) -> Float[np.ndarray, "n n"]:
    """Periodic noise of this amplitude spectrum, of zero mean and unit standard deviation."""
    rng = np.random.default_rng(seed)
    noise = np.fft.rfft2(rng.standard_normal((TEXTURE_CELLS, TEXTURE_CELLS)))
    down, across = (
        np.fft.fftfreq(TEXTURE_CELLS, TEXTURE_PITCH),
        np.fft.rfftfreq(TEXTURE_CELLS, TEXTURE_PITCH),
    )
    amplitude = spectrum(2 * np.pi * np.hypot(down[:, None], across))
    amplitude[0, 0] = 0.0
    texture = np.fft.irfft2(noise * amplitude, s=(TEXTURE_CELLS, TEXTURE_CELLS))
    return (texture / texture.std()).astype(np.float32)


def _quantised(view: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    return np.clip(np.rint(view), 0, 255).astype(np.uint8)
