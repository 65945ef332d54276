"""Procedural looks of the phantom: band-limited, so that a camera never aliases them.

Everything is a sum of periodic noises of one wavelength each; an image can therefore be tiled. Skin
and speckle are rich enough for stereo matching everywhere; smooth skin and plastic are not, as they
are not in life. Colours are mixed in single precision: 256 levels need no more, and it takes a
third of the time.
"""

import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.special import expit

SKIN_TONE = np.array([220.0, 181.0, 163.0], np.float32)
AREOLA_TONE = np.array([170.0, 108.0, 98.0], np.float32)
FRECKLE_TINT = np.array([-58.0, -66.0, -66.0], np.float32)
PLASTIC_TONE = np.array([206.0, 209.0, 212.0], np.float32)
PRINTED_RING = 3e-3
"""Spacing of the rings that a printer leaves, as coarse as a camera still sees [m]."""
VEIN_TINT = np.array([-12.0, -4.0, 1.0], np.float32)
GRAIN_TINT = np.array([1.1, 1.0, 0.95], np.float32)
BLUSH_TINT = np.array([0.4, -0.7, -0.5], np.float32)
BANDWIDTH = 0.25
"""Relative width of a noise's band (standard deviation) [-]."""
NEGLIGIBLE = 9.0
"""Widths from a band's middle at which a frequency is below rounding [-]."""
STRIP = 16
"""Rows that are coloured at a time."""


def skin(
    rng: np.random.Generator, size: int, pixel: float, areola_radius: float = 0.0
) -> UInt8[np.ndarray, "size size 3"]:
    """Skin with pores, freckles, faint veins and a blotchy blush; an areola in the centre if it has
    a radius.

    Args:
        rng: Draws the pattern.
        size: Side of the image [px].
        pixel: Side of a pixel on the skin [m].
        areola_radius: Radius of the areola [m]; 0 for none.
    """

    def noise(wavelength: float) -> Float32[np.ndarray, "size size"]:
        return band_noise(rng, size, wavelength / pixel).astype(np.float32)

    areola = (
        _disc(size, areola_radius / pixel, 0.05 * noise(8e-3))
        if areola_radius
        else np.zeros((size, size), np.float32)
    )
    blush = noise(30e-3)
    veins, vein_patches = noise(36e-3), noise(40e-3)
    grain = 10 * noise(2.2e-3) + 10 * noise(4e-3) + 4 * noise(8e-3)
    freckles, freckle_patches = noise(3.2e-3), noise(25e-3)
    tints = [AREOLA_TONE - SKIN_TONE, 2 * BLUSH_TINT, VEIN_TINT, GRAIN_TINT, FRECKLE_TINT]
    image = np.empty((size, size, 3), np.uint8)
    for top in range(0, size, STRIP):  # a few rows fit the cache, the whole does not
        rows = slice(top, top + STRIP)
        vein = _ridge(veins[rows], 0.16) * _patches(vein_patches[rows]) * (1 - areola[rows])
        freckle = _spots(freckles[rows], 1.3) * _patches(freckle_patches[rows])
        layers = [areola[rows], blush[rows], vein, grain[rows], freckle]
        for c in range(3):
            colour = np.full(vein.shape, SKIN_TONE[c])
            for layer, tint in zip(layers, tints, strict=True):
                colour += layer * tint[c]
            image[rows, :, c] = np.clip(np.rint(colour), 0, 255)
    return image


def speckle(rng: np.random.Generator, size: int, pixel: float) -> UInt8[np.ndarray, "size size 3"]:
    """Dark dots of about 2 mm sprayed on a light ground, as for digital image correlation;
    `pixel` in m.
    """
    dots = _spots(band_noise(rng, size, 4e-3 / pixel), 0.2)
    grey = 225 - 180 * dots + 6 * band_noise(rng, size, 2.2e-3 / pixel)
    return np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def smooth(
    rng: np.random.Generator, size: int, pixel: float, areola_radius: float = 0.0
) -> UInt8[np.ndarray, "size size 3"]:
    """Skin without pores, freckles and veins: a faint blotchy blush and hardly any grain;
    arguments as for `skin`.
    """
    areola = (
        _disc(size, areola_radius / pixel, np.zeros((size, size), np.float32))
        if areola_radius
        else np.zeros((size, size), np.float32)
    )
    image = SKIN_TONE + areola[..., None] * (AREOLA_TONE - SKIN_TONE)
    image += 2 * band_noise(rng, size, 30e-3 / pixel)[..., None] * BLUSH_TINT
    image += 1.5 * band_noise(rng, size, 4e-3 / pixel)[..., None] * GRAIN_TINT
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def plastic(rng: np.random.Generator, size: int, pixel: float) -> UInt8[np.ndarray, "size size 3"]:
    """A plain light filament, slightly mottled, with the printer's rings around the centre;
    `pixel` in m.
    """
    axis = (np.arange(size) + 0.5 - size / 2) * pixel
    rings = np.cos(2 * np.pi * np.hypot(axis[:, None], axis[None, :]) / PRINTED_RING)
    grey = 2.0 * rings + 1.5 * band_noise(rng, size, 6e-3 / pixel)
    return np.clip(np.rint(PLASTIC_TONE + grey[..., None]), 0, 255).astype(np.uint8)


def band_noise(
    rng: np.random.Generator, size: int, wavelength_px: float
) -> Float[np.ndarray, "size size"]:
    """Periodic noise of zero mean and unit variance in a narrow band
    around `wavelength_px`.
    """
    # the columns of the spectrum beyond the band are never computed: they would be most of the work
    columns = int(size * (1 + BANDWIDTH * NEGLIGIBLE) / wavelength_px) + 1
    across = np.fft.rfftfreq(size)[:columns]
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], across)
    gain = np.exp(-0.5 * ((frequency * wavelength_px - 1) / BANDWIDTH) ** 2)
    gain[0, 0] = 0.0
    white = np.fft.rfft(rng.standard_normal((size, size)), axis=1)[:, :columns]
    spectrum = np.fft.fft(white, axis=0) * gain
    spectrum /= _deviation(spectrum, size)
    return np.fft.irfft(np.fft.ifft(spectrum, axis=0), n=size, axis=1)


def _deviation(spectrum: np.ndarray, size: int) -> float:
    """Standard deviation of the real image that has the first columns of its spectrum, zero mean
    and nothing in the others (Parseval).
    """
    power = np.sum(np.real(spectrum) ** 2 + np.imag(spectrum) ** 2, axis=0)
    once = power[:: size // 2]  # the columns of frequency 0 and 1/2 have no mirror image
    return float(np.sqrt(2 * power.sum() - once.sum())) / size**2


def _spots(noise: np.ndarray, threshold: float) -> np.ndarray:
    """0 to 1: soft-edged blobs where the noise is above the threshold."""
    return expit(4 * (noise - threshold))


def _patches(noise: np.ndarray) -> np.ndarray:
    """.2 to 1: freckles and veins show in patches."""
    return 0.6 + 0.4 * np.tanh(2 * noise)


def _ridge(noise: np.ndarray, width: float) -> np.ndarray:
    """0 to 1: soft lines along the zeros of the noise."""
    return np.exp(-0.5 * (noise / width) ** 2)


def _disc(size: int, radius_px: float, edge: np.ndarray) -> np.ndarray:
    """1 inside a disc in the centre, 0 outside, with a soft edge displaced by `edge` (in radii)."""
    axis = np.arange(size, dtype=np.float32) + (1 - size) / 2
    distance = np.hypot(axis[:, None], axis[None, :]) / radius_px + edge
    return expit((1 - distance) / 0.06)
