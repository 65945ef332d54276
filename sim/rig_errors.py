"""How far is an estimated rig from the one that the twin was built with?"""

import numpy as np

from breastscan.geometry import se3
from breastscan.vision.camera import StereoRig


def rig_errors(rig: StereoRig, truth: StereoRig) -> dict[str, float]:
    """Errors of the cameras' relative pose and, where the rig has one, of its place in the
    robot's base.
    """
    rotation_deg = np.degrees(se3.rotation_vector(rig.X_RL @ se3.inverse(truth.X_RL)))
    errors = {
        "baseline_error_mm": abs(rig.baseline - truth.baseline) * 1e3,
        "yaw_error_deg": float(abs(rotation_deg[1])),
    }
    if rig.X_BL is None or truth.X_BL is None:
        return errors
    X_LL = se3.inverse(truth.X_BL) @ rig.X_BL
    return errors | {
        "handeye_error_mm": float(np.linalg.norm(X_LL[:3, 3])) * 1e3,
        "handeye_error_deg": float(np.degrees(np.linalg.norm(se3.rotation_vector(X_LL)))),
    }
