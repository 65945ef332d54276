# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""Drawing the scene off screen: the arm at given joint angles, the skin as deformed."""

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from breastscan.geometry import se3
from sim.arm.ur5e import joint_names
from sim.cameras import opengl
from sim.cameras.filament import FilamentCanvas
from sim.room.describe import COLLISION_GROUP
from sim.scene import Scene


class Picture:
    """A canvas of fixed size on which the scene is drawn. Close it."""

    def __init__(
        self, scene: Scene, width: int, height: int, *, shadows: bool = True, fine: bool = False
    ) -> None:
        """Open the canvas.

        Args:
            scene: What is drawn.
            width: Width [px].
            height: Height [px].
            shadows: Whether the classic renderer's key light casts shadows; they take half the
                time.
            fine: Whether `sim.cameras.filament` draws; it must be usable.

        Raises:
            ConfigError: No OpenGL is usable.
        """
        self._scene = scene
        self._model = scene.pictures
        self._data = mujoco.MjData(self._model)
        self._joints = [self._model.joint(name).qposadr[0] for name in joint_names()]
        self._options = mujoco.MjvOption()
        self._options.geomgroup[COLLISION_GROUP] = 0
        self._options.sitegroup[:] = 0
        self._options.flags[mujoco.mjtVisFlag.mjVIS_FLEXSKIN] = 1
        self._canvas = (
            FilamentCanvas(self._model, width, height)
            if fine
            else ClassicCanvas(self._model, width, height, shadows)
        )

    def arrange(
        self,
        q: Float[np.ndarray, "6"],
        skin_S: Float[np.ndarray, "n 3"] | None = None,
        time: float = 0.0,
    ) -> None:
        """Show the instant `time` [s]: the arm at `q` [rad], the skin's vertices at `skin_S` [m]
        or undeformed.
        """
        X_BS = self._scene.X_BS_at(time)
        self._data.qpos[self._joints] = q
        self._data.mocap_pos[0] = X_BS[:3, 3]
        mujoco.mj_forward(self._model, self._data)
        if skin_S is not None:
            self._data.flexvert_xpos[:] = se3.transform(X_BS, skin_S)

    def draw(self, camera: str | mujoco.MjvCamera) -> UInt8[np.ndarray, "h w 3"]:
        """RGB picture from a camera of the scene or a free one; valid until the next call."""
        return self._canvas.draw(
            self._data, self._fixed(camera) if isinstance(camera, str) else camera, self._options
        )

    def _fixed(self, name: str) -> mujoco.MjvCamera:
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = (
            mujoco.mjtCamera.mjCAMERA_FIXED,
            self._model.camera(name).id,
        )
        return camera

    def close(self) -> None:
        """Give the graphics memory back."""
        self._canvas.close()


class ClassicCanvas:
    """MuJoCo's classic renderer, whose light and tone the simulated cameras are set for.

    Edges are jagged: callers draw larger than they need and reduce by area, which is cheaper
    without a graphics card than the renderer's own smoothing, and smooths textures as well.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, shadows: bool) -> None:
        self._renderer = open_renderer(model, width, height)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows

    def draw(
        self, data: mujoco.MjData, camera: mujoco.MjvCamera, options: mujoco.MjvOption
    ) -> UInt8[np.ndarray, "h w 3"]:
        """RGB picture; valid until the next call."""
        self._renderer.update_scene(data, camera, options)
        return self._renderer.render()

    def close(self) -> None:
        """Give the graphics memory back."""
        self._renderer.close()


def open_renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """An off-screen canvas of this size [px] for `model`; it smooths no edges.

    Raises:
        ConfigError: No OpenGL is usable.
    """
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples = 0
    try:
        return mujoco.Renderer(model, height, width)
    except Exception as error:
        raise opengl.missing(error) from error
