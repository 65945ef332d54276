"""What to say where nothing can be drawn."""

from breastscan.errors import ConfigError


def missing(error: Exception) -> ConfigError:
    """The error to raise when an OpenGL context or the library behind it cannot be had."""
    return ConfigError(
        f"the twin needs OpenGL to draw, and none is usable here ({error}): on Debian and Ubuntu "
        "install libegl1, libgles2 and libgl1-mesa-dri (no graphics card is needed), and without a "
        "display set MUJOCO_GL=egl before mujoco is imported",
        error,
    )
