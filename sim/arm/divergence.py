# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""A simulation whose numbers have run away: what went wrong, and a file to look at it."""

import os
import tempfile

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.errors import RobotError
from breastscan.robot.ur.ur5e import SPEED_LIMIT

DIVERGED_SPEED = 10 * SPEED_LIMIT
"""Joint speed that no command can cause [rad/s]."""


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether a step left speeds that no command can cause, or no numbers at all."""
    return not float(data.qvel @ data.qvel) < DIVERGED_SPEED**2


def report(
    data: mujoco.MjData,
    q: Float[np.ndarray, "6"],
    qd: Float[np.ndarray, "6"],
    X_SP: Float[np.ndarray, "4 4"],
) -> RobotError:
    """The error that ends the run. It names the time, the cause and a file with the state before
    the last step.

    Args:
        data: After the step.
        q: Joint angles before it [rad].
        qd: Joint speeds before it [rad/s].
        X_SP: Pose of the probe tip in the phantom, before it.
    """
    handle, path = tempfile.mkstemp(prefix="breastscan-diverged-", suffix=".npz")
    with os.fdopen(handle, "wb") as stream:
        np.savez(
            stream,
            time=data.time,
            q=q,
            qd=qd,
            X_SP=X_SP,
            commands=data.ctrl,
            applied=data.xfrc_applied,
            qvel_after=data.qvel,
            qacc=data.qacc,
        )
    time = float(data.time) - data.model.opt.timestep
    return RobotError(
        f"the simulation diverged at {time:.3f} s: {_cause(data, qd)}. The state before is in "
        f"{path}",
        path,
    )


def _cause(data: mujoco.MjData, qd: np.ndarray) -> str:
    if not np.isfinite(data.xfrc_applied).all():
        return "the tissue's contact force is not a number"
    if np.abs(qd).max() > SPEED_LIMIT:
        worst = int(np.abs(qd).argmax())
        return f"joint {worst + 1} moves at {qd[worst]:.1f} rad/s, which no command asked for"
    strongest = np.linalg.norm(data.xfrc_applied[:, :3], axis=1).max()
    return f"a force of {strongest:.0f} N on the probe throws the arm about"
