"""Two GenICam cameras (GigE Vision, USB3 Vision) as a stereo camera, by the library harvesters."""

import time
import weakref
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from breastscan.camera.interface import StereoPair
from breastscan.errors import ConfigError, PerceptionError

TIMEOUT = 3.0
"""Longest wait for a picture after its trigger [s]."""
MAX_SKEW = 0.005
"""Maximum time between the two triggers [s]: a breathing skin moves at 10 mm/s, which makes .05 mm
of it."""
SETTINGS = (
    ("PixelFormat", "Mono8"),
    ("TriggerSelector", "FrameStart"),
    ("TriggerMode", "On"),
    ("TriggerSource", "Software"),
)
"""What is set on both cameras, in this order, by the names of GenICam's standard features; exposure
and gain stay as they are."""


class GenicamCamera:
    """Implements `breastscan.robot.interface.StereoCamera` on two GenICam cameras, triggered by
    software one right after the other. The cameras' clocks need not agree: a pair's time is the
    host's, midway between the triggers.
    """

    def __init__(self, harvester: Any, serials: tuple[str, str] | None = None) -> None:
        """Open both cameras and start them.

        Args:
            harvester: A `harvesters.core.Harvester` that knows its producer, as `load_producer`
                makes it.
            serials: Serial numbers of the left and the right camera; None for the first two that
                are found.

        Raises:
            PerceptionError: A camera is not there.
        """
        found = [info.serial_number for info in harvester.device_info_list]
        if serials is None and len(found) >= 2:
            serials = (found[0], found[1])
        if serials is None or not set(serials) <= set(found):
            wanted = "two cameras" if serials is None else f"cameras {serials[0]} and {serials[1]}"
            raise PerceptionError(
                f"expected {wanted}, the producer finds {', '.join(found) or 'none'}: check power, "
                "cables, addresses",
                found,
            )
        self.serials = serials
        """Serial numbers of the left and the right camera."""
        self._cameras: list[Any] = []
        self._release = weakref.finalize(self, _release, harvester, self._cameras)
        for serial in serials:
            camera = harvester.create({"serial_number": serial})
            self._cameras.append(camera)
            for feature, value in SETTINGS:
                getattr(camera.remote_device.node_map, feature).value = value
            camera.start()
        self.skew = 0.0
        """By how much the right camera was triggered later than the left for the latest pair
        [s]."""

    def close(self) -> None:
        """Stop both cameras and let them go; happens by itself at the latest when the program
        ends.
        """
        self._release()

    def capture(self) -> StereoPair:
        """Trigger both and take their pictures.

        Raises:
            PerceptionError: The triggers were too far apart, or a picture did not come or is not
                8-bit grey.
        """
        left_time, right_time = (self._trigger(camera) for camera in self._cameras)
        self.skew = right_time - left_time
        left, right = (
            _fetch(c, serial) for c, serial in zip(self._cameras, self.serials, strict=True)
        )
        if self.skew > MAX_SKEW:
            raise PerceptionError(
                f"the two triggers came {1e3 * self.skew:.1f} ms apart, expected "
                f"{1e3 * MAX_SKEW:g} ms at most: the computer is too busy, or the cameras need a "
                "trigger by wire",
                self.skew,
            )
        return StereoPair(left=left, right=right, time=(left_time + right_time) / 2)

    @staticmethod
    def _trigger(camera: Any) -> float:
        camera.remote_device.node_map.TriggerSoftware.execute()
        return time.monotonic()


def load_producer(producer: Path) -> Any:
    """A harvester with the cameras that a vendor's GenTL producer finds.

    Args:
        producer: The vendor's .cti file.

    Raises:
        ConfigError: harvesters is not installed, or there is no such file.
    """
    try:
        from harvesters.core import Harvester  # pyright: ignore[reportMissingImports] (an extra)
    except ImportError as error:
        raise ConfigError(
            "GenICam cameras need the library harvesters: install it with pip install "
            "'breastscan[genicam]'",
            error,
        ) from error
    if not producer.is_file():
        raise ConfigError(
            f"no GenTL producer at {producer}: expected the .cti file of the cameras' vendor",
            producer,
        )
    harvester = Harvester()
    harvester.add_file(str(producer))
    harvester.update()
    return harvester


def _fetch(camera: Any, serial: str) -> UInt8[np.ndarray, "h w"]:
    """The picture that was triggered, copied out of the driver's buffer."""
    buffer = camera.try_fetch(timeout=TIMEOUT)
    if buffer is None:
        raise PerceptionError(
            f"camera {serial} gave no picture within {TIMEOUT:g} s of its trigger: check its cable "
            "and its exposure",
            serial,
        )
    with buffer:
        picture = buffer.payload.components[0]
        if picture.data_format != "Mono8":
            raise PerceptionError(
                f"camera {serial} gives {picture.data_format}, expected Mono8: set its pixel "
                "format",
                picture.data_format,
            )
        return picture.data.reshape(picture.height, picture.width).copy()


def _release(harvester: Any, cameras: list[Any]) -> None:
    for camera in cameras:
        camera.stop()
        camera.destroy()
    harvester.reset()
