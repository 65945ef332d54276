"""Where the controller's tool can go, for whatever tool centre point is set."""

import numpy as np
from jaxtyping import Float

from breastscan.geometry import se3
from sim.controller.controller import Controller
from sim.controller.urscript.values import Pose, ScriptError, shown


def reaching(controller: Controller, pose: Pose) -> Float[np.ndarray, "k 6"]:
    """All joint angles that take the tool to a pose [rad]."""
    return controller.robot.calibration.inverse(pose.matrix @ se3.inverse(controller.X_FT))


def inverse(
    controller: Controller, pose: Pose, near: Float[np.ndarray, "6"] | None = None
) -> Float[np.ndarray, "6"]:
    """The solution nearest to joint angles, whole turns included; by default to where the arm is
    [rad].

    Raises:
        ScriptError: There is none.
    """
    start = controller.robot.commanded[0] if near is None else near
    solutions = reaching(controller, pose)
    if not solutions.size:
        raise ScriptError(f"no joint angles reach {shown(pose)}", pose)
    differences = (solutions - start + np.pi) % (2 * np.pi) - np.pi
    return start + differences[np.abs(differences).max(axis=1).argmin()]
