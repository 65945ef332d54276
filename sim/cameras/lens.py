"""From an ideal pinhole picture to the light on a real camera's sensor: distortion, shading, blur.

MuJoCo draws pinholes. So an undistorted canvas is drawn that reaches as far as the lens sees, with
more pixels than needed against aliasing, and resampled through the inverse of the lens distortion.
"""

from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy.polynomial import Polynomial

from breastscan.vision.camera import Intrinsics, StereoRig
from sim.cameras.camera_errors import CameraErrors

PIXEL_PITCH = 4.8e-6
"""Pixel pitch of the PYTHON 1300 sensor [m]."""
X_CG = np.diag([1.0, -1.0, -1.0, 1.0])
"""MuJoCo's camera (y up, looking along -z) in OpenCV's (y down, looking along +z)."""
UNDISTORT_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-10)
FIELD_FRACTION = 0.99
"""Fraction of the polynomial's turning radius that is used: closer, its inverse is too steep to
compute."""
OUTSIDE_PX = -1000.0
INTERPOLATION_MARGIN = 5
"""Canvas beyond the outermost ray [px]: Lanczos interpolation takes four pixels to each side."""
CAMERAS_KEPT = 4
"""Cameras whose rays are remembered: two rigs."""
Packed = tuple[bytes, bytes, int, int]
"""A camera's K and distortion, width and height: as a key."""
CANVAS_STEP = 8
"""The canvas' size and origin are multiples of this [px], so that it can be binned as the image
is."""


def canvases(rig: StereoRig, supersampling: int) -> dict[str, Intrinsics]:
    """The ideal pinholes to draw for the cameras `left` and `right`: each reaches as far as its
    lens sees.

    Both are of one size, `supersampling` times finer than the images, without distortion, along the
    same optical axes.
    """
    seen = {"left": _seen(rig.left), "right": _seen(rig.right)}
    width, height = np.max([size for _, size in seen.values()], axis=0)
    return {
        side: _resampled(
            _moved(getattr(rig, side), origin, int(width), int(height)), supersampling, 1
        )
        for side, (origin, _) in seen.items()
    }


def binned(camera: Intrinsics, factor: int) -> Intrinsics:
    """The same view with `factor` x `factor` pixels read out as one."""
    return _resampled(camera, 1, factor)


def mujoco_camera(pinhole: Intrinsics, X_WC: Float[np.ndarray, "4 4"]) -> dict[str, object]:
    """MJCF attributes of a camera with this pinhole at `X_WC` (OpenCV's axes)."""
    X_WG = X_WC @ X_CG
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


def pixel_rays(camera: Intrinsics) -> Float[np.ndarray, "n 3"]:
    """Directions (x, y, 1) in the camera's frame of what its pixels look at, row by row; NaN
    where no ray arrives.
    """
    pixels = _pixels(camera)
    rays = np.column_stack([_undistorted(camera, pixels, np.eye(3)), np.ones(len(pixels))])
    rays[_off_axis(camera, pixels) > _field_stop(camera)] = np.nan
    return rays


class Lens:
    """Turns a drawn canvas into the light on the camera's sensor."""

    def __init__(
        self, camera: Intrinsics, canvas: Intrinsics, supersampling: int, errors: CameraErrors
    ) -> None:
        """Prepare the lens of `camera`; `canvas` is drawn `supersampling` times finer than the
        camera's pixels.
        """
        self._supersampling = supersampling
        self._blur_px = errors.blur_px
        reduced = binned(canvas, supersampling)
        positions = _canvas_positions(camera, reduced)
        self._map_x, self._map_y = positions[..., 0].copy(), positions[..., 1].copy()
        rays = (positions - reduced.K[:2, 2]) / reduced.K[[0, 1], [0, 1]]
        self._shading = (1 + (rays**2).sum(axis=2)).astype(np.float32) ** np.float32(
            -errors.vignetting / 2
        )

    def bend(self, drawn: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h2 w2"]:
        """Light on the sensor [grey levels, not rounded]."""
        grey = cv2.cvtColor(drawn, cv2.COLOR_RGB2GRAY).astype(np.float32)
        # on the fine canvas: half a pixel is too narrow for a Gaussian of whole pixels
        if self._blur_px > 0:
            grey = cv2.GaussianBlur(grey, (0, 0), self._blur_px * self._supersampling)
        scale = 1 / self._supersampling
        reduced = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        light = cv2.remap(reduced, self._map_x, self._map_y, cv2.INTER_LANCZOS4).astype(
            np.float32, copy=False
        )
        return light * self._shading


def _seen(camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    """Origin and size [px] of the rectangle in the ideal image plane of `camera` that its pixels
    look at.

    The distortion grows with the radius, so the outermost rays are those of the image's rim, or of
    the field stop where the rim lies beyond it.
    """
    rim = _rim(camera)
    focal, centre = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    ray = (rim - centre) / focal
    ray *= np.minimum(1, _field_stop(camera) / np.linalg.norm(ray, axis=1, keepdims=True))
    looked_at = _undistorted(camera, ray * focal + centre, camera.K)
    low = np.floor((looked_at.min(axis=0) - INTERPOLATION_MARGIN) / CANVAS_STEP) * CANVAS_STEP
    high = np.ceil((looked_at.max(axis=0) + INTERPOLATION_MARGIN + 1) / CANVAS_STEP) * CANVAS_STEP
    return low, high - low


def _rim(camera: Intrinsics) -> Float[np.ndarray, "n 2"]:
    """Places of the outermost pixels [px]."""
    x, y = np.arange(float(camera.width)), np.arange(float(camera.height))
    rows = [np.stack([x, np.full_like(x, end)], axis=1) for end in (y[0], y[-1])]
    columns = [np.stack([np.full_like(y, end), y], axis=1) for end in (x[0], x[-1])]
    return np.concatenate([*rows, *columns])


def _pixels(camera: Intrinsics) -> Float[np.ndarray, "n 2"]:
    """Places of all pixels, row by row [px]."""
    return np.indices((camera.height, camera.width), float)[::-1].reshape(2, -1).T.copy()


def _moved(
    camera: Intrinsics, origin: Float[np.ndarray, "2"], width: int, height: int
) -> Intrinsics:
    """An ideal pinhole along the camera's axis whose image starts at `origin` of the camera's
    [px].
    """
    K = camera.K.copy()
    K[:2, 2] -= origin
    return Intrinsics(K=K, distortion=np.zeros(5), width=width, height=height)


def _resampled(camera: Intrinsics, up: int, down: int) -> Intrinsics:
    """The same view with every pixel divided into `up` x `up`, and `down` x `down` of these read
    out as one.
    """
    K = camera.K.copy()
    K[:2, 2] += 0.5
    K[:2] *= up
    K[:2] /= down
    K[:2, 2] -= 0.5
    width, height = camera.width * up // down, camera.height * up // down
    return Intrinsics(K=K, distortion=camera.distortion, width=width, height=height)


def _undistorted(
    camera: Intrinsics, pixels: Float[np.ndarray, "n 2"], K: np.ndarray
) -> Float[np.ndarray, "n 2"]:
    """Where the rays of the camera's `pixels` meet the image of the ideal pinhole `K` [px]."""
    return cv2.undistortPointsIter(
        pixels[:, None], camera.K, camera.distortion, np.eye(3), K, UNDISTORT_UNTIL
    )[:, 0]


def _canvas_positions(camera: Intrinsics, pinhole: Intrinsics) -> Float32[np.ndarray, "h w 2"]:
    """Where on the canvas [px] each pixel of the camera's image looks; far outside where the
    lens lets no ray in.
    """
    return _kept_positions(_packed(camera), _packed(pinhole))


def _packed(camera: Intrinsics) -> Packed:
    """A camera as a key."""
    K, distortion = camera.K.astype(float), camera.distortion.astype(float)
    return K.tobytes(), distortion.tobytes(), camera.width, camera.height


def _unpacked(packed: Packed) -> Intrinsics:
    K, distortion, width, height = packed
    return Intrinsics(
        K=np.frombuffer(K).reshape(3, 3),
        distortion=np.frombuffer(distortion),
        width=width,
        height=height,
    )


@lru_cache(maxsize=CAMERAS_KEPT)
def _kept_positions(packed: Packed, packed_pinhole: Packed) -> Float32[np.ndarray, "h w 2"]:
    """See `_canvas_positions`: a third of a second, the same in every scene with this camera."""
    camera, pinhole = _unpacked(packed), _unpacked(packed_pinhole)
    pixels = _pixels(camera)
    positions = _undistorted(camera, pixels, pinhole.K)
    positions[_off_axis(camera, pixels) > _field_stop(camera)] = OUTSIDE_PX
    positions = positions.reshape(camera.height, camera.width, 2).astype(np.float32)
    positions.flags.writeable = False
    return positions


def _off_axis(camera: Intrinsics, pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Distorted radius [focal lengths] of `pixels`."""
    return np.linalg.norm((pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], axis=1)


def _field_stop(camera: Intrinsics) -> float:
    """Distorted radius [focal lengths] beyond which no ray arrives.

    A distortion polynomial with falling high orders turns back at some radius: pixels farther out,
    in the extreme corners of some lenses, have no ray and stay dark.
    """
    k1, k2, _, _, k3, k4, k5, k6 = np.pad(camera.distortion, (0, 8))[:8]
    square = Polynomial([0.0, 1.0])
    over, under = Polynomial([1.0, k1, k2, k3]), Polynomial([1.0, k4, k5, k6])
    # of radius times over / under, by the radius
    growth = (over + 2 * square * over.deriv()) * under - 2 * square * over * under.deriv()
    extrema = growth.roots()
    squares = extrema[(np.abs(extrema.imag) < 1e-12) & (extrema.real > 0)].real
    if len(squares) == 0:
        return np.inf
    first = squares.min()
    return float(FIELD_FRACTION * np.sqrt(first) * over(first) / under(first))
