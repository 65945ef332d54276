"""The stereo rig as calibrated, and rectification to row-aligned pairs [Zhang, Sec. II-A, Fig.
5].
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.errors import CalibrationError, PerceptionError
from breastscan.geometry import se3

SHORTEST_BASELINE = 1e-3
"""Distance of two optical centres below which no depth can be measured [m]."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """One camera: pinhole and Brown-Conrady distortion, in OpenCV's conventions (pixel centres
    at integers).
    """

    K: Float[np.ndarray, "3 3"]
    """Camera matrix [px]."""
    distortion: Float[np.ndarray, "5"]
    """k1, k2, p1, p2, k3 on undistorted normalised coordinates [Zhang, Eq. 1, in OpenCV's
    order]."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""

    def __post_init__(self) -> None:
        if not (self.K[0, 0] > 0 and self.K[1, 1] > 0 and min(self.width, self.height) > 0):
            raise CalibrationError(
                f"no camera has focal lengths of {self.K[0, 0]:g}, {self.K[1, 1]:g} px and "
                f"{self.width}x{self.height} px: is the camera matrix transposed, or empty?",
                self.K,
            )


@dataclass(frozen=True, kw_only=True)
class RectifiedPair:
    """A pair whose corresponding points share a row: the left point (x, y) lies at (x -
    disparity, y) on the right.
    """

    left: UInt8[np.ndarray, "h w"]
    right: UInt8[np.ndarray, "h w"]
    focal_px: float
    """Common focal length [px]."""
    centre_px: tuple[float, float]
    """Common principal point (x, y) [px]."""
    baseline: float
    """Distance of the two optical centres [m]."""
    R_LV: Float[np.ndarray, "3 3"]
    """Rotation from the rectified left view V to the left camera L (same optical centre)."""


@dataclass(frozen=True, kw_only=True)
class StereoRig:
    """Two calibrated cameras and, once hand-eye calibrated, their place in the robot's base
    frame.
    """

    left: Intrinsics
    right: Intrinsics
    X_RL: Float[np.ndarray, "4 4"]
    """Left camera in the right one: p_R = X_RL p_L [m]."""
    X_BL: Float[np.ndarray, "4 4"] | None = None
    """Left camera in the robot base, from hand-eye calibration [m]; None before it."""

    @property
    def baseline(self) -> float:
        """Distance of the two optical centres [m]."""
        return float(np.linalg.norm(self.X_RL[:3, 3]))

    @staticmethod
    def load(path: str | Path) -> "StereoRig":
        """Read a rig from an OpenCV FileStorage file.

        Raises:
            CalibrationError: The file is missing, is not a rig, or holds numbers that no camera can
                have.
        """
        path = Path(path)
        if not path.is_file():
            raise CalibrationError(
                f"no rig file at {path}: give one with --rig, or calibrate first", path
            )
        try:
            storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        except (cv2.error, SystemError) as error:
            raise _not_a_rig(path, "OpenCV cannot parse it") from error
        if not storage.isOpened():
            raise _not_a_rig(path, "OpenCV cannot open it")
        cameras = [
            Intrinsics(
                K=_matrix(storage, path, f"camera_matrix_{side}", (3, 3)),
                distortion=_matrix(storage, path, f"distortion_{side}", (1, 5)).reshape(5),
                width=_length(storage, path, f"image_width_{side}"),
                height=_length(storage, path, f"image_height_{side}"),
            )
            for side in ("left", "right")
        ]
        X_RL = _rigid(_matrix(storage, path, "X_RL", (4, 4)), path, "X_RL")
        has_hand_eye = not storage.getNode("X_BL").empty()
        X_BL = (
            _rigid(_matrix(storage, path, "X_BL", (4, 4)), path, "X_BL") if has_hand_eye else None
        )
        storage.release()
        if np.linalg.norm(X_RL[:3, 3]) < SHORTEST_BASELINE:
            raise _not_a_rig(path, "the cameras' baseline is below 1 mm")
        return StereoRig(left=cameras[0], right=cameras[1], X_RL=X_RL, X_BL=X_BL)

    def save(self, path: str | Path) -> None:
        """Write the rig where `load`, OpenCV's FileStorage and any YAML reader that knows
        `!!opencv-matrix` read it.
        """
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for side, camera in (("left", self.left), ("right", self.right)):
            storage.write(f"image_width_{side}", camera.width)
            storage.write(f"image_height_{side}", camera.height)
            storage.write(f"camera_matrix_{side}", camera.K)
            storage.write(f"distortion_{side}", camera.distortion.reshape(1, 5))
        storage.write("X_RL", self.X_RL)
        if self.X_BL is not None:
            storage.write("X_BL", self.X_BL)
        storage.release()

    def rectify(
        self, left: UInt8[np.ndarray, "h w"], right: UInt8[np.ndarray, "h2 w2"]
    ) -> RectifiedPair:
        """Undistort and rotate both images until their rows are aligned.

        Lanczos interpolation: it leaves half the depth error of linear interpolation.

        Raises:
            PerceptionError: The images do not have the size that the rig was calibrated for.
        """
        for side, image, camera in (("left", left, self.left), ("right", right, self.right)):
            if image.shape != (camera.height, camera.width):
                raise PerceptionError(
                    f"the {side} image is {image.shape[1]}x{image.shape[0]} px, but the rig was "
                    f"calibrated for {camera.width}x{camera.height} px: use the rig file of this "
                    "camera setting",
                    image.shape,
                )
        maps, focal_px, centre_px, R_LV = self._rectification
        views = [
            cv2.remap(image, *m, cv2.INTER_LANCZOS4)
            for image, m in zip((left, right), maps, strict=True)
        ]
        return RectifiedPair(
            left=views[0].astype(np.uint8, copy=False),
            right=views[1].astype(np.uint8, copy=False),
            focal_px=focal_px,
            centre_px=centre_px,
            baseline=self.baseline,
            R_LV=R_LV,
        )

    @cached_property
    def _rectification(self):
        """Both remap tables, the common focal length and centre, and the rotation of the left
        view.
        """
        size = (self.left.width, self.left.height)
        R1, R2, P1, P2, *_ = cv2.stereoRectify(
            self.left.K, self.left.distortion, self.right.K, self.right.distortion, size,
            self.X_RL[:3, :3], self.X_RL[:3, 3], flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1,
        )  # fmt: skip
        maps = [
            cv2.initUndistortRectifyMap(c.K, c.distortion, R, P, size, cv2.CV_32FC1)
            for c, R, P in ((self.left, R1, P1), (self.right, R2, P2))
        ]
        return maps, float(P1[0, 0]), (float(P1[0, 2]), float(P1[1, 2])), R1.T


def _not_a_rig(path: Path, reason: str) -> CalibrationError:
    return CalibrationError(
        f"{path} is not a rig file ({reason}): expected what StereoRig.save writes", path
    )


def _matrix(storage: cv2.FileStorage, path: Path, key: str, shape: tuple[int, int]) -> np.ndarray:
    node = storage.getNode(key)
    value = None if node.empty() or not node.isMap() else node.mat()
    if value is None or value.shape != shape:
        raise _not_a_rig(path, f"{key} of shape {shape} is missing")
    if not np.isfinite(value).all():
        raise _not_a_rig(path, f"{key} holds a number that is not finite")
    return value.astype(float)


def _length(storage: cv2.FileStorage, path: Path, key: str) -> int:
    node = storage.getNode(key)
    if node.empty() or not node.isInt() or node.real() < 1:
        raise _not_a_rig(path, f"{key} is missing or not a positive whole number")
    return int(node.real())


def _rigid(X: np.ndarray, path: Path, key: str) -> np.ndarray:
    """`X` with its rotation replaced by the nearest proper one, so that rounded files compose
    exactly.
    """
    U, singular, Vt = np.linalg.svd(X[:3, :3])
    if np.abs(singular - 1).max() > 1e-2 or np.linalg.det(U @ Vt) < 0:
        raise _not_a_rig(path, f"the rotation of {key} is not one")
    return se3.pose(U @ Vt, X[:3, 3])
