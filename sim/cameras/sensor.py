"""From light to grey levels: photons, read-out, gain, converter."""

import numpy as np
from jaxtyping import Float32, UInt8

from sim.cameras.camera_errors import FULL_WELL, REFERENCE_EXPOSURE, WHITE, CameraConfig


def expose(
    light: Float32[np.ndarray, "h w"], config: CameraConfig, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w"]:
    """The 8-bit image of `light` [grey levels of an ideal camera at the reference exposure].

    Poisson's law of the photons is taken as Gaussian: beyond 20 electrons, half a grey level, the
    two are alike.
    """
    errors = config.errors
    brightness = config.exposure_time / REFERENCE_EXPOSURE
    electrons = np.clip(light * np.float32(brightness * FULL_WELL / WHITE), 0, FULL_WELL)
    variance = errors.read_noise**2 + (electrons if errors.shot_noise else np.float32(0))
    if errors.shot_noise or errors.read_noise > 0:
        electrons += np.sqrt(variance) * rng.standard_normal(light.shape, dtype=np.float32)
    top = 2**errors.bits - 1
    codes = np.rint(electrons * np.float32(config.gain * top / FULL_WELL))
    return (np.clip(codes, 0, top).astype(np.uint16) >> (errors.bits - 8)).astype(np.uint8)
