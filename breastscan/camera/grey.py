"""Pictures as 8-bit grey, whatever file or camera they come from."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan.errors import PerceptionError

SIXTEEN_BIT_MAX = 65535.0
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
SUFFIXES = (".png", ".tiff", ".tif", ".jpg", ".jpeg", ".bmp")
"""Of the files that are taken for pictures."""


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
            f"{path} is not an image, or is damaged: expected a whole PNG, TIFF or JPEG file of 8 "
            f"or 16 bit, got {len(content)} bytes: copy it again from the camera",
            path,
        )
    if image.dtype == np.uint16:
        image = cv2.convertScaleAbs(image, alpha=255.0 / SIXTEEN_BIT_MAX)
    return image


def _is_cut_jpeg(content: bytes) -> bool:
    """Whether a JPEG file lacks its end; OpenCV would fill the missing rows with grey and not
    say so.
    """
    return content.startswith(JPEG_START) and JPEG_END not in content[-64:]
