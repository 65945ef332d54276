# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""What the hulls of arm and tool touch, the chest plate among it, and how hard.

The probe's face and the tissue are not among these: their contact is `sim.tissue`'s.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from sim.room.chest import CHEST_HULL
from sim.room.describe import ARM_BIT

PLAIN_NAMES = {
    "probe_hull": "the probe's body",
    "sensor_hull": "the wrist sensor",
    CHEST_HULL: "the chest plate",
    "table_hull": "the table",
    "crossbar_hull": "the cameras' crossbar",
    "boom_hull": "the camera stand's boom",
    "post_hull": "the camera stand's post",
    "cameras_hull": "the cameras",
}
"""What a user is told for a hull's name; the links have their numbers."""
LINK = "link"
"""How the names of the links' hulls begin, before the number."""


class RigidContact(NamedTuple):
    """What rigid shapes did to arm and tool in one control period."""

    time: float
    """Robot's clock [s]."""
    chest_S: Float[np.ndarray, "3"]
    """Force of the chest plate on arm and tool together [N]."""
    force: float
    """Force between the two shapes that press each other hardest [N]."""
    of_arm: str
    """Name of the arm's or tool's shape of the two."""
    of_other: str
    """Name of the other."""


def rigid_contact(
    model: mujoco.MjModel, data: mujoco.MjData, time: float, R_SB: Float[np.ndarray, "3 3"]
) -> RigidContact:
    """The contacts of the latest step, of which there is one at least, at `time` [s]."""
    forces_B: dict[tuple[int, int], np.ndarray] = {}
    wrench = np.empty(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        mujoco.mj_contactForce(model, data, number, wrench)
        first, second = contact.geom.tolist()
        force_B = wrench[:3] @ contact.frame.reshape(3, 3)  # of the first shape on the second
        of_arm_first = model.geom_contype[first] == ARM_BIT
        pair = (first, second) if of_arm_first else (second, first)
        on_arm_B = -force_B if of_arm_first else force_B
        forces_B[pair] = forces_B.get(pair, np.zeros(3)) + on_arm_B
    hardest = max(forces_B, key=lambda pair: float(np.linalg.norm(forces_B[pair])))
    chest = model.geom(CHEST_HULL).id
    of_chest_B = [force_B for (_, other), force_B in forces_B.items() if other == chest]
    return RigidContact(
        time=time,
        chest_S=R_SB @ np.sum([np.zeros(3), *of_chest_B], axis=0),
        force=float(np.linalg.norm(forces_B[hardest])),
        of_arm=model.geom(hardest[0]).name,
        of_other=model.geom(hardest[1]).name,
    )


def plain_name(hull: str) -> str:
    """What a user is told for a hull: "the chest plate", "link 4 of the arm"."""
    if hull.startswith(LINK):
        number = hull.removeprefix(LINK).partition("_")[0]
        return f"link {number} of the arm"
    return PLAIN_NAMES.get(hull, hull)
