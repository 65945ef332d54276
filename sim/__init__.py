"""The twin: arm, probe, soft phantom, wrist sensor and stereo rig in MuJoCo; what programs start
from.

MuJoCo and dm_control choose their OpenGL backend when first imported, so the choice for machines
without a display is made here, before any module of this package can import them. A name is
imported when it is first asked for: `import sim` does not load MuJoCo.
"""

import os
import sys
from typing import TYPE_CHECKING

from breastscan.exports import lazily

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

if TYPE_CHECKING:
    from sim.scene import Scene as Scene
    from sim.scene import SceneConfig as SceneConfig
    from sim.tissue.breathing import BreathingConfig as BreathingConfig
    from sim.tissue.phantom_config import PhantomConfig as PhantomConfig
    from sim.twin import Twin as Twin

HOMES = {
    "BreathingConfig": "tissue.breathing",
    "PhantomConfig": "tissue.phantom_config",
    "Scene": "scene",
    "SceneConfig": "scene",
    "Twin": "twin",
}
"""In which module of this package each name lives."""

__getattr__, __dir__ = lazily(__name__, HOMES)
