"""From an ideal pinhole picture to what a real camera delivers: distortion, grey levels, noise.

MuJoCo draws pinholes. So a larger, undistorted canvas is drawn, with more pixels than needed against aliasing,
and resampled through the inverse of the lens distortion.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from breastscan.errors import ConfigError
from breastscan.vision.camera import Intrinsics

CANVAS_SCALE = 1.25
"""Size of the canvas over that of the image: room for what the distortion pulls in from outside."""
PIXEL_PITCH = 4.8e-6
"""Pixel pitch of the PYTHON 1300 sensor [m]."""
X_CAMERA_GL = np.diag([1.0, -1.0, -1.0, 1.0])
"""MuJoCo's camera (y up, looking along -z) in OpenCV's (y down, looking along +z)."""
UNDISTORT_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
FIELD_SHARE = 0.99
"""Share of the polynomial's turning radius that is used: closer to it, its inverse is too steep to compute."""
OUTSIDE_PX = -1000.0


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """How well the cameras see."""

    supersampling: int = 2
    """Drawn pixels per image pixel, each way [-]."""
    noise: float = 1.0
    """Standard deviation of the sensor's noise [grey levels]."""
    seed: int = 0
    """Draws the noise."""

    def __post_init__(self) -> None:
        if self.supersampling not in (1, 2, 3):
            raise ConfigError(f"supersampling must be 1, 2 or 3, got {self.supersampling}", self.supersampling)
        if not 0 <= self.noise < np.inf:
            raise ConfigError(f"camera noise must be finite and not negative, got {self.noise}", self.noise)


def canvas(camera: Intrinsics, supersampling: int) -> Intrinsics:
    """The ideal pinhole to draw for `camera`: larger, finer, without distortion, with the same optical axis."""
    size = np.array([camera.width, camera.height])
    margin = np.ceil((CANVAS_SCALE - 1) * size / 2)
    width, height = (size + 2 * margin).astype(int) * supersampling
    K = camera.K.copy()
    K[:2, 2] += margin + 0.5
    K[:2] *= supersampling
    K[:2, 2] -= 0.5
    return Intrinsics(K=K, distortion=np.zeros(5), width=int(width), height=int(height))


def mujoco_camera(pinhole: Intrinsics, X_WC: Float[np.ndarray, "4 4"]) -> dict[str, object]:
    """MJCF attributes of a camera with this pinhole at `X_WC` (OpenCV's axes)."""
    X_WG = X_WC @ X_CAMERA_GL
    size = np.array([pinhole.width, pinhole.height])
    centre = pinhole.K[:2, 2]
    return {
        "pos": X_WG[:3, 3],
        "xyaxes": np.concatenate([X_WG[:3, 0], X_WG[:3, 1]]),
        "resolution": size,
        "sensorsize": size * PIXEL_PITCH,
        "focalpixel": np.array([pinhole.K[0, 0], pinhole.K[1, 1]]),
        "principalpixel": size / 2 - centre - 0.5,
    }


class Lens:
    """Resamples a drawn canvas to the camera's own, distorted image."""

    def __init__(self, camera: Intrinsics, supersampling: int) -> None:
        self._supersampling = supersampling
        positions = _canvas_positions(camera, canvas(camera, 1))
        self._map_x, self._map_y = positions[..., 0].copy(), positions[..., 1].copy()

    def bend(self, drawn: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h2 w2"]:
        """Grey levels, not rounded, of the camera's image."""
        grey = cv2.cvtColor(drawn, cv2.COLOR_RGB2GRAY).astype(np.float32)
        share = 1 / self._supersampling
        reduced = cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        return cv2.remap(reduced, self._map_x, self._map_y, cv2.INTER_LANCZOS4).astype(np.float32, copy=False)


def expose(grey: Float32[np.ndarray, "h w"], noise: float, rng: np.random.Generator) -> UInt8[np.ndarray, "h w"]:
    """An 8-bit exposure of `grey` with noise of standard deviation `noise` [grey levels]."""
    noisy = grey + np.float32(noise) * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _canvas_positions(camera: Intrinsics, pinhole: Intrinsics) -> Float32[np.ndarray, "h w 2"]:
    """Where on the canvas [px] each pixel of the camera's image looks; far outside where the lens lets no ray in."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    positions = cv2.undistortPointsIter(
        pixels[:, None], camera.K, camera.distortion, np.eye(3), pinhole.K, UNDISTORT_UNTIL
    )[:, 0]
    off_axis = np.linalg.norm((pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], axis=1)
    positions[off_axis > _field_stop(camera)] = OUTSIDE_PX
    return positions.reshape(camera.height, camera.width, 2).astype(np.float32)


def _field_stop(camera: Intrinsics) -> float:
    """Distorted radius [focal lengths] beyond which no ray arrives.

    A distortion polynomial with falling high orders turns back at some radius: pixels farther out, in the extreme
    corners of some lenses, have no ray and stay dark.
    """
    k1, k2, _, _, k3 = camera.distortion
    turns = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    squares = turns[(np.abs(turns.imag) < 1e-12) & (turns.real > 0)].real
    if len(squares) == 0:
        return np.inf
    square = squares.min()
    return float(FIELD_SHARE * np.sqrt(square) * (1 + k1 * square + k2 * square**2 + k3 * square**3))
