# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""MuJoCo's physically based renderer: soft light and contact shadows, for stills and films.

It needs Vulkan; without a graphics card Mesa's lavapipe serves, at about half a second a picture.
What it draws is for people: light and tone are not those that the simulated cameras are calibrated
to.
"""

import ctypes.util
import subprocess
import sys
from functools import cache

import mujoco
import numpy as np
from jaxtyping import UInt8

PACKAGES = "libvulkan1 mesa-vulkan-drivers"
"""Debian's and Ubuntu's packages for Vulkan, with or without a graphics card."""
PROBE_TIME = 120
"""Longest time that a driver may take to draw the probe's picture [s]."""
PROBE = """
import mujoco
import mujoco.studio
from mujoco import mjrf
mjrf.Context(mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN))
"""


@cache
def unusable() -> str | None:
    """Why this renderer cannot be used here; None where it can. A child process asks, since
    drivers may end theirs.
    """
    if ctypes.util.find_library("vulkan") is None:
        return f"there is no Vulkan (on Debian and Ubuntu: apt-get install {PACKAGES})"
    try:
        child = subprocess.run(
            [sys.executable, "-c", PROBE], capture_output=True, text=True, timeout=PROBE_TIME
        )
    except subprocess.TimeoutExpired:
        return f"Vulkan does not answer within {PROBE_TIME} s"
    if child.returncode != 0:
        last = (
            child.stderr.strip() or child.stdout.strip() or f"exit status {child.returncode}"
        ).splitlines()[-1]
        return f"Vulkan does not work ({last}; on Debian and Ubuntu: apt-get install {PACKAGES})"
    return None


class FilamentCanvas:
    """A canvas of fixed size, as `sim.cameras.picture.ClassicCanvas` is. Ask `unusable` first."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        import mujoco.studio  # noqa: F401 (brings the renderer's materials)
        from mujoco import mjrf

        self._mjrf, self._model = mjrf, model
        self._context = mjrf.Context(
            mjrf.ContextConfig(graphics_api=mjrf.GraphicsApi.GRAPHICS_API_VULKAN)
        )
        self._resources = mjrf.ModelResources(self._context, model)
        self._scene = self._context.create_scene(mjrf.SceneParams())
        self._scene.configure_from_model(model)
        self._lights = mjrf.ModelLights(self._scene, self._resources)
        self._shapes = mjrf.ModelRenderables(self._scene, self._resources)
        config = mjrf.RenderTargetConfig(color_format=mjrf.PixelFormat.PIXEL_FORMAT_RGB8)
        self._target = self._context.create_render_target(config)
        self._target.resize(width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)
        self._read = mjrf.ReadRequest(target=self._target)
        self._read.set_buffer(self._pixels)

    def draw(
        self, data: mujoco.MjData, camera: mujoco.MjvCamera, options: mujoco.MjvOption
    ) -> UInt8[np.ndarray, "h w 3"]:
        """RGB picture; valid until the next call."""
        self._shapes.set_options(options)
        self._lights.update(data)
        self._shapes.update(data)
        request = self._mjrf.RenderRequest()
        request.scene, request.target = self._scene, self._target
        request.camera = self._camera(data, camera)
        request.viewport.left = request.viewport.bottom = 0
        request.viewport.height, request.viewport.width, _ = self._pixels.shape
        self._context.wait_for_frame(self._context.render([request], [self._read]))
        return self._pixels

    def _camera(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> object:
        view = mujoco.mjv_camera2GLCamera(self._model, data, camera)
        return self._mjrf.Camera(
            pos=view.pos,
            forward=view.forward,
            up=view.up,
            frustum_bottom=view.frustum_bottom,
            frustum_top=view.frustum_top,
            frustum_near=view.frustum_near,
            frustum_far=view.frustum_far,
        )

    def close(self) -> None:
        """Give the graphics memory back, what was made last first."""
        for name in ("_read", "_target", "_shapes", "_lights", "_scene", "_resources", "_context"):
            delattr(self, name)
