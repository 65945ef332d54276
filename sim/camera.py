"""The simulated stereo camera: the rig's own intrinsics, distortion and noise."""

import numpy as np

from breastscan.robot.interface import StereoPair
from sim.lens import Lens, canvas, expose
from sim.picture import Picture
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene


class SimStereoCamera:
    """Implements `breastscan.robot.interface.StereoCamera` in the twin."""

    def __init__(self, scene: Scene, robot: SimRobot | None = None) -> None:
        """Set the rig's two cameras up.

        Args:
            scene: What they see.
            robot: Whose arm stands in the scene and presses the skin; without one, the arm is parked.

        Raises:
            ConfigError: No OpenGL is usable.
        """
        config = scene.config.camera
        self._robot = robot
        self._noise = config.noise
        self._rng = np.random.default_rng(config.seed)
        self._lenses = {side: Lens(getattr(scene.rig, side), config.supersampling) for side in ("left", "right")}
        drawn = canvas(scene.rig.left, config.supersampling)
        self._picture = Picture(scene, drawn.width, drawn.height)

    def capture(self) -> StereoPair:
        """Draw, distort and expose both views of the present instant."""
        q, skin_S, time = HOME_Q, None, 0.0
        if self._robot is not None:
            q, skin_S, time = self._robot.snapshot()
        self._picture.arrange(q, skin_S)
        left, right = (
            expose(self._lenses[side].bend(self._picture.draw(side)), self._noise, self._rng)
            for side in ("left", "right")
        )
        return StereoPair(left=left, right=right, time=time)

    def close(self) -> None:
        """Give the graphics memory back."""
        self._picture.close()
