"""Two video devices as a stereo camera, by OpenCV."""

import time

import cv2
import numpy as np
from jaxtyping import UInt8

from breastscan.camera.interface import StereoPair
from breastscan.errors import ConfigError, PerceptionError

MAX_SKEW = 0.01
"""Maximum time between the two pictures of a pair [s]: a breathing skin moves at 10 mm/s, which
makes .1 mm of it."""
CATCH_UP = 30
"""Pictures of the earlier camera that are skipped to come within `MAX_SKEW`; then the two are given
up."""
BUFFERED = 4
"""Pictures that a driver keeps from before `capture` was called: V4L2's usual number. A device
drops as many."""
MS_PER_S = 1e3


class VideoCamera:
    """Implements `breastscan.robot.interface.StereoCamera` on two `cv2.VideoCapture`.

    Both pictures are grabbed, which is quick, and only then decoded. A picture's time is what the
    driver says (`CAP_PROP_POS_MSEC`), or the host's clock as the grab returns where the driver says
    nothing. Free-running cameras can only be matched as closely as their pictures come; whoever
    needs better triggers them by wire.
    """

    def __init__(self, left: int | str, right: int | str) -> None:
        """Open both.

        Args:
            left: Number of the left device, or a video file to play.
            right: Likewise.

        Raises:
            PerceptionError: One does not open.
        """
        if left == right:
            raise ConfigError(
                f"left and right are one device, {left}: give the numbers of two", left
            )
        self._names = left, right
        self._captures = tuple(_opened(name) for name in self._names)
        self.skew = 0.0
        """By how much the right picture of the latest pair is later than the left [s]."""

    def capture(self) -> StereoPair:
        """Take one pair, from after this call.

        Raises:
            PerceptionError: A camera gives no picture, or the two do not come within the greatest
                skew.
        """
        for name, capture in zip(self._names, self._captures, strict=True):
            for _ in range(BUFFERED if isinstance(name, int) else 0):
                _grab(capture, name)
        times = self._grab_together()
        self.skew = times[1] - times[0]
        left, right = (_grey(c, name) for c, name in zip(self._captures, self._names, strict=True))
        return StereoPair(left=left, right=right, time=sum(times) / 2)

    def _grab_together(self) -> tuple[float, float]:
        """Grab both, then the earlier one again until they belong together; their times [s]."""
        clocks, stamps = zip(
            *(_grab(c, n) for c, n in zip(self._captures, self._names, strict=True)), strict=True
        )
        stamped = all(stamps)
        times = list(stamps if stamped else clocks)
        for _ in range(CATCH_UP):
            if abs(times[1] - times[0]) <= MAX_SKEW:
                return times[0], times[1]
            earlier = int(times[1] < times[0])
            clock, stamp = _grab(self._captures[earlier], self._names[earlier])
            times[earlier] = stamp if stamped else clock
        skew = times[1] - times[0]
        raise PerceptionError(
            f"the pictures of devices {self._names[0]} and {self._names[1]} are {1e3 * skew:.1f} "
            f"ms apart, expected {1e3 * MAX_SKEW:g} ms at most: let both run at one rate, or "
            "trigger them by wire",
            skew,
        )


def _opened(name: int | str) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(name)
    if not capture.isOpened():
        raise PerceptionError(
            f"video device {name} does not open: check its cable and number, and that no other "
            "program has it",
            name,
        )
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture


def _grab(capture: cv2.VideoCapture, name: int | str) -> tuple[float, float]:
    """Grab one picture; the host's clock and the driver's stamp [s], 0 where it has none."""
    if not capture.grab():
        raise PerceptionError(
            f"video device {name} gives no picture: check its cable, or whether its film is over",
            name,
        )
    return time.monotonic(), capture.get(cv2.CAP_PROP_POS_MSEC) / MS_PER_S


def _grey(capture: cv2.VideoCapture, name: int | str) -> UInt8[np.ndarray, "h w"]:
    """Decode what was grabbed."""
    decoded, image = capture.retrieve()
    if not decoded or image.dtype != np.uint8:
        raise PerceptionError(
            f"the picture of video device {name} cannot be decoded as 8-bit grey or colour", name
        )
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
