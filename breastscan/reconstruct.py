"""A stereo pair on disk to a point cloud: the perception of a scan without a robot."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan import record
from breastscan.errors import PerceptionError
from breastscan.robot.interface import StereoPair
from breastscan.scan import Reconstruction, ScanConfig, Stages, perceive
from breastscan.vision.camera import StereoRig

SIXTEEN_BIT_MAX = 65535.0


def reconstruct(left: Path, right: Path, rig_file: Path, out: Path, config: ScanConfig) -> Reconstruction:
    """Write `cloud.ply` (in the left camera's frame) and `disparity.png` of an image pair into `out`.

    Raises:
        CalibrationError: The rig file is not one.
        PerceptionError: An image cannot be read, the sizes differ from the rig's, or no breast is in view.
        ConfigError: `out` cannot be written.
    """
    rig = StereoRig.load(rig_file)
    images = StereoPair(left=read_grey(left), right=read_grey(right), time=0.0)
    with record.staged(out) as folder:
        result = perceive(images, rig, config, Stages())
        record.write_image(folder / "disparity.png", record.disparity_picture(result.disparity))
        record.write_cloud(folder / "cloud.ply", result.sampled_L, result.normals_L)
    return result


def read_grey(path: Path) -> UInt8[np.ndarray, "h w"]:
    """An image as 8-bit grey, whatever its depth and colours.

    Raises:
        PerceptionError: There is no such file, or it is not an image that OpenCV reads.
    """
    if not path.is_file():
        raise PerceptionError(f"no image at {path}: expected a PNG, TIFF or JPEG file", path)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if image is None:
        raise PerceptionError(f"{path} is not an image, or is damaged: expected a PNG, TIFF or JPEG file", path)
    if image.dtype != np.uint8:
        image = cv2.convertScaleAbs(image, alpha=255.0 / SIXTEEN_BIT_MAX)
    return image
