# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The arm let go: without friction, drives and compensation it must neither win nor lose energy."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float

from sim.arm.ur5e import add_arm
from sim.room.describe import Element, mjcf
from sim.wrist.wrench_sensor import GRAVITY_W

DURATION = 10.0
"""Length of the swing [s]."""
START_Q = np.array([0.0, -0.3, 0.4, -1.0, 0.7, 0.0])
"""Arm stretched out level [rad]: it falls through half a rotation."""
START_QD = np.array([0.5, 0.0, 0.0, 1.0, 0.0, 2.0])
"""Speeds it is let go with [rad/s]."""
STEPS_BETWEEN = 5
"""Steps between two looks at the energy."""
INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "Euler": mujoco.mjtIntegrator.mjINT_EULER}


@dataclass(frozen=True, kw_only=True)
class Swing:
    """Energy of one swing."""

    time: Float[np.ndarray, "n"]
    """[s]"""
    drift: Float[np.ndarray, "n"]
    """Change of the total energy since the start, over the largest kinetic energy of the swing
    [-]."""

    @property
    def largest(self) -> float:
        """Largest drift, up or down [-]."""
        return float(np.abs(self.drift).max())


def swing(
    integrator: Literal["RK4", "Euler"], timestep: float, duration: float = DURATION
) -> Swing:
    """Let the arm swing for `duration` [s], in steps of `timestep` [s]."""
    model = _conservative()
    model.opt.integrator, model.opt.timestep = INTEGRATORS[integrator], timestep
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = START_Q, START_QD
    time, energy = [], []
    for _ in range(round(duration / timestep / STEPS_BETWEEN)):
        # the energy of this state, not of a stage within the last step
        mujoco.mj_forward(model, data)
        time.append(data.time)
        energy.append(data.energy.copy())
        mujoco.mj_step(model, data, STEPS_BETWEEN)
    total, kinetic = np.sum(energy, axis=1), np.array(energy)[:, 1]
    return Swing(time=np.array(time), drift=(total - total[0]) / kinetic.max())


def _conservative() -> mujoco.MjModel:
    """The bare arm under gravity alone."""
    root: Element = mjcf.RootElement()
    root.compiler.angle = "radian"
    root.option.gravity = GRAVITY_W
    root.option.flag.set_attributes(
        actuation="disable", contact="disable", limit="disable", energy="enable"
    )
    add_arm(root)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.body_gravcomp[:] = 0.0
    return model
