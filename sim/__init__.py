"""The twin: arm, probe, soft phantom, wrist sensor and stereo rig in MuJoCo.

MuJoCo and dm_control choose their OpenGL backend when first imported, so the choice for machines
without a display is made here, before any module of this package can import them.
"""

import os
import sys

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")
