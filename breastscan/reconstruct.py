"""A stereo pair on disk to a point cloud and a depth map: the perception of a scan without a robot."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan import record
from breastscan.errors import PerceptionError
from breastscan.robot.interface import StereoPair
from breastscan.scan import Reconstruction, ScanConfig, Stages, perceive
from breastscan.vision.camera import StereoRig
from breastscan.vision.pair_check import check_exposure
from breastscan.vision.triangulation import depth_map

SIXTEEN_BIT_MAX = 65535.0
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"


def reconstruct(left: Path, right: Path, rig_file: Path, out: Path, config: ScanConfig) -> Reconstruction:
    """Write what an image pair shows into `out`.

    `cloud.ply` holds points of the breast in the left camera's frame, `disparity.png` a picture of the whole view, and
    `depth.tiff` its depth along the axis of the rectified left view [m], 32-bit float, NaN where unknown.

    Raises:
        CalibrationError: The rig file is not one.
        PerceptionError: An image cannot be read, shows nothing, has another size than the rig's, the two are exchanged,
            or no breast is in view.
        ConfigError: `out` cannot be written.
    """
    rig = StereoRig.load(rig_file)
    images = StereoPair(left=read_grey(left), right=read_grey(right), time=0.0)
    check_exposure(images.left, str(left))
    check_exposure(images.right, str(right))
    with record.staged(out) as folder:
        result = perceive(images, rig, config, Stages())
        record.write_image(folder / "disparity.png", record.disparity_picture(result.disparity))
        record.write_image(folder / "depth.tiff", depth_map(result.disparity, result.pair))
        record.write_cloud(folder / "cloud.ply", result.sampled_L, result.normals_L)
    return result


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """An image as 8-bit grey, whatever its depth and colours.

    Raises:
        PerceptionError: There is no such file, or it is not a whole image that OpenCV reads.
    """
    if not path.is_file():
        raise PerceptionError(f"no image at {path}: expected a PNG, TIFF or JPEG file", path)
    content = path.read_bytes()
    image = None
    if content and not _is_cut_jpeg(content):
        encoded = np.frombuffer(content, np.uint8)
        image = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise PerceptionError(
            f"{path} is not an image, or is damaged: expected a whole PNG, TIFF or JPEG file of 8 or 16 bit, got "
            f"{len(content)} bytes: copy it again from the camera",
            path,
        )
    if image.dtype == np.uint16:
        image = cv2.convertScaleAbs(image, alpha=255.0 / SIXTEEN_BIT_MAX)
    return image


def _is_cut_jpeg(content: bytes) -> bool:
    """Whether a JPEG file lacks its end; OpenCV would fill the missing rows with grey and not say so."""
    return content.startswith(JPEG_START) and JPEG_END not in content[-64:]
