"""Pictures as 8-bit grey, whatever file or camera they come from."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan.errors import PerceptionError

DEPTHS = (10, 12, 16)
"""Bits of what cameras write into 16; of a picture the fewest that hold it."""
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_SCAN = 0xDA
"""Marker after which a JPEG's pixels come, up to its end."""
SUFFIXES = (".png", ".tiff", ".tif", ".jpg", ".jpeg", ".bmp", ".pgm", ".webp")
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
        largest = next(full for bits in DEPTHS if image.max() <= (full := 2**bits - 1))
        image = cv2.convertScaleAbs(image, alpha=255.0 / largest)
    return image


def _is_cut_jpeg(content: bytes) -> bool:
    """Whether a JPEG file lacks its end; OpenCV would fill the missing rows with grey and not
    say so. Behind its end there may be anything, and before its pixels a preview with an end of its
    own.
    """
    if not content.startswith(JPEG_START):
        return False
    at = len(JPEG_START)
    while at + 4 <= len(content) and content[at + 1] != JPEG_SCAN:
        at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    return JPEG_END not in content[at:]
