"""The simulated stereo camera: the rig's own intrinsics, distortion and sensor."""

import numpy as np
from jaxtyping import Float, Float32

from breastscan.camera.interface import StereoPair
from sim.cameras.camera_errors import CameraConfig
from sim.cameras.lens import Lens, binned, canvases
from sim.cameras.picture import Picture
from sim.cameras.sensor import expose
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene


class SimStereoCamera:
    """Implements `breastscan.robot.interface.StereoCamera` in the twin."""

    def __init__(self, scene: Scene, robot: SimRobot | None = None, *, binning: int = 1) -> None:
        """Set the rig's two cameras up.

        Args:
            scene: What they see.
            robot: Whose arm stands in the scene and presses the skin; without one, the arm is
                parked.
            binning: Pixels read out as one, each way: small images, drawn quickly.

        Raises:
            ConfigError: No OpenGL is usable.
        """
        self._robot = robot
        self._config = config = scene.config.camera
        self._rng = np.random.default_rng(config.seed or 0)
        self._moments = _moments(config)
        full = canvases(scene.rig, config.supersampling)
        drawn = {side: binned(canvas, binning) for side, canvas in full.items()}
        self._lenses = {
            side: Lens(
                binned(getattr(scene.rig, side), binning),
                canvas,
                config.supersampling,
                config.errors,
            )
            for side, canvas in drawn.items()
        }
        self._picture = Picture(scene, drawn["left"].width, drawn["left"].height)

    def capture(self) -> StereoPair:
        """Draw, distort and expose both views of the present instant."""
        time = 0.0 if self._robot is None else self._robot.state().time
        views = zip(*(self._light(moment) for moment in self._moments), strict=True)
        left, right = (expose(np.mean(light, axis=0), self._config, self._rng) for light in views)
        return StereoPair(left=left, right=right, time=time)

    def _light(
        self, moment: float
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h2 w2"]]:
        """Light on the left and the right sensor at `moment` [s] from now."""
        if self._robot is None:
            self._picture.arrange(HOME_Q)
        else:
            q, skin_S, time = self._robot.snapshot()
            self._picture.arrange(q + moment * self._robot.state().qd, skin_S, time + moment)
        left, right = (
            self._lenses[side].bend(self._picture.draw(side)) for side in ("left", "right")
        )
        return left, right

    def close(self) -> None:
        """Give the graphics memory back."""
        self._picture.close()


def _moments(config: CameraConfig) -> Float[np.ndarray, "n"]:
    """When the pictures of one exposure, which ends now, are drawn [s]: now for one, else evenly
    over it.
    """
    count = config.motion_samples
    return (
        config.exposure_time * ((np.arange(count) + 0.5) / count - 1) if count > 1 else np.zeros(1)
    )
