"""The stereo rig as calibrated, and rectification to row-aligned pairs [Zhang, Sec. II-A, Fig.
5].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.errors import CalibrationError, PerceptionError
from breastscan.geometry import se3
from breastscan.vision.rigs import reading
from breastscan.vision.rigs.found import FoundCamera, FoundRig
from breastscan.vision.rigs.trees import not_a_rig

SHORTEST_BASELINE, LONGEST_BASELINE = 1e-3, 2.0
"""Distance of two optical centres below which no depth can be measured, and above which lengths
were hardly metres [m]."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """One camera: pinhole and Brown-Conrady distortion, in OpenCV's conventions (pixel centres
    at integers).
    """

    K: Float[np.ndarray, "3 3"]
    """Camera matrix [px]."""
    distortion: Float[np.ndarray, "k"]
    """k1, k2, p1, p2, k3 on undistorted normalised coordinates [Zhang, Eq. 1, in OpenCV's
    order], and where the lens has them k4 to k6, s1 to s4, tau_x and tau_y."""
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
    def load(*paths: str | Path, unit: float | None = None) -> "StereoRig":
        """Read a rig from a file of ours, or of OpenCV, ROS, Kalibr, MATLAB or Middlebury.

        Args:
            paths: The file; of ROS, or where intrinsics and extrinsics are apart, two.
            unit: Of its lengths [m]; None for what the file says, and metres where it says nothing.

        Raises:
            CalibrationError: A file is missing, is not a rig, or holds numbers that no camera or no
                pair of cameras side by side can have.
        """
        files = [Path(path) for path in paths]
        return StereoRig.of(reading.read(files), files[0], unit)

    @staticmethod
    def of(found: FoundRig, path: Path, unit: float | None = None) -> "StereoRig":
        """The rig that a file says; arguments and errors as for `load`."""
        metres = unit or found.unit or 1.0
        X_RL = _rigid(se3.pose(found.R_RL, metres * found.p_RL), path, "X_RL")
        X_BL = None if found.X_BL is None else _rigid(found.X_BL, path, "X_BL")
        _require_side_by_side(X_RL[:3, 3], path)
        left, right = (
            _camera(camera, path, side)
            for side, camera in (("left", found.left), ("right", found.right))
        )
        return StereoRig(left=left, right=right, X_RL=X_RL, X_BL=X_BL)

    def save(self, path: str | Path, warnings: Sequence[str] = ()) -> None:
        """Write the rig where `load`, OpenCV's FileStorage and any YAML reader that knows
        `!!opencv-matrix` read it; as comments what speaks against it.
        """
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for side, camera in (("left", self.left), ("right", self.right)):
            storage.write(f"image_width_{side}", camera.width)
            storage.write(f"image_height_{side}", camera.height)
            storage.write(f"camera_matrix_{side}", camera.K)
            storage.write(f"distortion_{side}", camera.distortion.reshape(1, -1))
        storage.write("X_RL", self.X_RL)
        if self.X_BL is not None:
            storage.write("X_BL", self.X_BL)
        for warning in warnings:
            storage.writeComment(f"Accepted in spite of this: {warning}")
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
        (R_left, P), right = self.rectified_views
        size = (self.left.width, self.left.height)
        maps = [
            cv2.initUndistortRectifyMap(c.K, c.distortion, *view, size, cv2.CV_32FC1)
            for c, view in ((self.left, (R_left, P)), (self.right, right))
        ]
        return maps, float(P[0, 0]), (float(P[0, 2]), float(P[1, 2])), R_left.T

    @property
    def rectified_views(
        self,
    ) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Of the left and the right camera: rotation to its rectified view, and that view's
        projection matrix [px, px m].
        """
        R1, R2, P1, P2, *_ = cv2.stereoRectify(
            self.left.K, self.left.distortion, self.right.K, self.right.distortion,
            (self.left.width, self.left.height), self.X_RL[:3, :3], self.X_RL[:3, 3],
            flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1,
        )  # fmt: skip
        return (R1, P1), (R2, P2)


def _camera(found: FoundCamera, path: Path, side: str) -> Intrinsics:
    """A camera that can be, of a lens that is known here."""
    if found.fisheye:
        raise not_a_rig(
            path,
            f"the {side} camera has an equidistant (fisheye) lens, and pictures of such are not "
            "rectified here: undistort them to a pinhole first, as cv2.fisheye does",
        )
    if found.size is None:
        raise not_a_rig(path, "the size of the pictures is missing: add image_width, image_height")
    K, cx = found.K, found.K[0, 2]
    width, height = found.size
    if K[2, 0] or K[2, 1] or K[1, 0] or K[2, 2] != 1.0:
        raise not_a_rig(
            path, f"the {side} camera matrix does not end in a row 0 0 1: is it transposed?"
        )
    if not (0.0 < cx < width and 0.0 < K[1, 2] < height):
        raise not_a_rig(
            path,
            f"the {side} camera's centre ({cx:g}, {K[1, 2]:g}) px lies outside of its picture of "
            f"{width}x{height} px",
        )
    return Intrinsics(K=K, distortion=found.distortion, width=width, height=height)


def _require_side_by_side(p_RL: Float[np.ndarray, "3"], path: Path) -> None:
    """Refuse a pair that is not one camera beside the other, the left one on the left."""
    baseline = float(np.linalg.norm(p_RL))
    if baseline < SHORTEST_BASELINE:
        raise not_a_rig(path, "the cameras' baseline is below 1 mm")
    if baseline > LONGEST_BASELINE:
        raise not_a_rig(
            path,
            f"the cameras' baseline is {baseline:.4g} m: are the lengths millimetres? Then "
            f"`breastscan rig {path} --unit mm` makes a rig file of it",
        )
    if abs(p_RL[1]) > abs(p_RL[0]):
        raise not_a_rig(
            path,
            f"the right camera stands {p_RL[1]:.4g} m above or below the left one, more than "
            "beside it: vertical pairs are not matched here, so turn cameras and pictures by 90 "
            "degrees and calibrate anew",
        )
    if p_RL[0] > 0.0:
        raise not_a_rig(
            path,
            "the right camera stands on the left of the left one: either the two are exchanged, or "
            "R and T are those from right to left and have to be inverted, or the rig hangs upside "
            "down: turn its pictures by 180 degrees, exchange them, and calibrate anew",
        )


def _rigid(X: np.ndarray, path: Path, key: str) -> np.ndarray:
    """`X` with its rotation replaced by the nearest proper one, so that rounded files compose
    exactly.
    """
    U, singular, Vt = np.linalg.svd(X[:3, :3])
    if np.abs(singular - 1).max() > 1e-2 or np.linalg.det(U @ Vt) < 0:
        raise not_a_rig(path, f"the rotation of {key} is not one")
    return se3.pose(U @ Vt, X[:3, 3])
