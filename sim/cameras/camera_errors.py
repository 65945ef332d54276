"""What a camera gets wrong: each error by itself, and the classes that set them all.

The drawn picture is what an ideal camera would see. Lens and focus shade and blur it
(`sim.cameras.lens`), the sensor counts its light in electrons and turns them into grey levels
(`sim.cameras.sensor`).
"""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from breastscan.errors import ConfigError

FULL_WELL = 8000.0
"""Electrons that fill a pixel of the PYTHON 1300 sensor at unit gain [e-]."""
WHITE = 255
"""Grey level of a full pixel."""
REFERENCE_EXPOSURE = 5e-3
"""Exposure time at which a drawn white just fills the pixels [s]."""
CONVERTER_BITS = (8, 10, 12)


@dataclass(frozen=True, kw_only=True)
class CameraErrors:
    """How a camera differs from one that is perfect but for its 256 grey levels."""

    vignetting: float = 0.0
    """Power of the off-axis angle's cosine with which light falls off [-]: 4 is the natural law of
    a thin lens."""
    blur_px: float = 0.0
    """Point spread of lens and focus: standard deviation of a Gaussian [px]. A lens of this focal
    length (3.3 mm) is in focus everywhere between 480 and 600 mm to a seventh of a pixel, so one
    width serves the whole image."""
    shot_noise: bool = False
    """Whether light comes in photons."""
    read_noise: float = 0.0
    """Noise of the read-out, one sigma [e-]."""
    bits: int = 8
    """Resolution of the converter: 8, 10 or 12; all but the upper 8 are dropped, as the camera's
    8-bit mode does."""


CAMERA_CLASSES = {
    "ideal": CameraErrors(),
    "one_grey_level": CameraErrors(read_noise=FULL_WELL / WHITE),
    "realistic": CameraErrors(
        vignetting=2.0, blur_px=0.5, shot_noise=True, read_noise=9.0, bits=10
    ),
}
"""Realistic: noise and converter as the sensor's data sheet has them; half the light left in the
corners, as wide-angle lenses of inverted design keep it; a contrast of one half at .33 line pairs a
pixel, as good lenses have it."""


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """How well the cameras see: a class of errors, any of which can be set by itself."""

    quality: Literal["ideal", "one_grey_level", "realistic"] = "one_grey_level"
    """Class of errors: only quantisation, Gaussian noise of one grey level, or everything as in a
    real camera."""
    vignetting: float | None = None
    """Power of the off-axis angle's cosine with which light falls off [-]; None for the class's."""
    blur_px: float | None = None
    """Standard deviation of the point spread [px]; None for the class's."""
    shot_noise: bool | None = None
    """Whether light comes in photons; None for the class's."""
    read_noise: float | None = None
    """Noise of the read-out, one sigma [e-]; None for the class's."""
    bits: int | None = None
    """Resolution of the converter, 8, 10 or 12; None for the class's."""
    exposure_time: float = REFERENCE_EXPOSURE
    """[s]; 5 ms exposes the phantom well at unit gain."""
    gain: float = 1.0
    """Analogue gain [-]: amplifies signal and shot noise alike, and saturates the earlier."""
    motion_samples: int = 1
    """Pictures averaged over the exposure; 1 for no motion blur. The arm moves between them, the
    skin does not."""
    supersampling: int = 2
    """Drawn pixels per image pixel, each way [-]."""
    seed: int | None = None
    """Draws the noise; None follows the seed of the whole."""

    def __post_init__(self) -> None:
        if self.quality not in CAMERA_CLASSES:
            raise ConfigError(
                f"quality must be one of {', '.join(CAMERA_CLASSES)}, got {self.quality!r}",
                self.quality,
            )
        for name in ("vignetting", "blur_px", "read_noise"):
            if not 0 <= getattr(self.errors, name) < np.inf:
                raise ConfigError(
                    f"{name} must be finite and not negative, got {getattr(self, name)}", self
                )
        if self.errors.bits not in CONVERTER_BITS:
            raise ConfigError(f"bits must be one of {CONVERTER_BITS}, got {self.bits}", self.bits)
        if not 0 < self.exposure_time <= 1:
            raise ConfigError(
                f"exposure_time must lie in 0 .. 1 s, got {self.exposure_time}", self.exposure_time
            )
        if not 1 <= self.gain < np.inf:
            raise ConfigError(
                f"gain must be 1 or more, got {self.gain}: shorten the exposure instead", self.gain
            )
        if self.supersampling not in (1, 2, 3):
            raise ConfigError(
                f"supersampling must be 1, 2 or 3, got {self.supersampling}", self.supersampling
            )
        if self.motion_samples < 1:
            raise ConfigError(
                f"motion_samples must be 1 or more, got {self.motion_samples}", self.motion_samples
            )

    @property
    def errors(self) -> CameraErrors:
        """The class's errors, with those that are set by themselves in place of them."""
        own = {field.name: getattr(self, field.name) for field in fields(CameraErrors)}
        return replace(
            CAMERA_CLASSES[self.quality],
            **{name: value for name, value in own.items() if value is not None},
        )
