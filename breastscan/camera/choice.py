"""From an option of the command line to a stereo camera."""

from pathlib import Path

from breastscan.camera.folder import FolderCamera
from breastscan.camera.genicam import GenicamCamera, load_producer
from breastscan.camera.interface import StereoCamera
from breastscan.camera.video import VideoCamera
from breastscan.errors import ConfigError

FORMS = (
    "folder:DIR, devices:LEFT,RIGHT (numbers, as devices:0,1) or "
    "genicam:CTI_FILE[,SERIAL_LEFT,SERIAL_RIGHT]"
)


def open_camera(option: str) -> StereoCamera:
    """The camera that an option names, in one of `FORMS`.

    Raises:
        ConfigError: The option has none of the forms.
        PerceptionError: The camera is not there.
    """
    kind, _, rest = option.partition(":")
    parts = rest.split(",")
    if kind == "folder" and rest:
        return FolderCamera(Path(rest))
    if kind == "devices" and len(parts) == 2 and all(part.isdecimal() for part in parts):
        return VideoCamera(int(parts[0]), int(parts[1]))
    if kind == "genicam" and len(parts) in (1, 3) and all(parts):
        return GenicamCamera(
            load_producer(Path(parts[0])), (parts[1], parts[2]) if len(parts) == 3 else None
        )
    raise ConfigError(f"there is no camera {option!r}: give {FORMS}", option)
