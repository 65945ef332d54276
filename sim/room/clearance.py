# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""How far an arm and its tool stay from themselves and from what stands around them in their
cell.
"""

from dataclasses import dataclass
from itertools import combinations, product

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.cell import Cell, Shape
from breastscan.errors import ConfigError
from sim.arm.ur5e import add_arm, joint_names
from sim.room.describe import (
    ARM_BIT,
    SURROUNDINGS_BIT,
    Element,
    add_collision,
    compiled,
    mjcf,
    placed,
)

MEASURED_UP_TO = 1.0
"""Distances beyond this are not told apart [m]."""
FIXED_LINKS = ("base", "link1")
"""Bodies that stand on the table by design."""


@dataclass(frozen=True, kw_only=True)
class Closest:
    """The closest pair of an arm's shape and another shape."""

    distance: float
    """Gap between them, negative where they overlap [m]."""
    of_arm: str
    """Name of the arm's or tool's shape."""
    of_other: str
    """Name of the other shape, of the surroundings or of the arm itself."""


class Clearance:
    """Distances between simple hulls around the links, the tool and the surroundings.

    Implements `breastscan.planning.joint_limits.Clearances`. Links that share a joint touch by
    design and are left out.
    """

    def __init__(self, cell: Cell, *, with_chest: bool = True) -> None:
        """Collect the pairs.

        Args:
            cell: Where the arm stands.
            with_chest: Whether the chest counts. The cell's own shapes are known to who plans in
                it; where the chest lies is for the cameras to find out.
        """
        self._model = compiled(_describe(cell, with_chest))
        self._data = mujoco.MjData(self._model)
        self._joints = [self._model.joint(name).qposadr[0] for name in joint_names()]
        arm = np.flatnonzero(self._model.geom_contype == ARM_BIT).tolist()
        fixed = [self._model.body(name).id for name in FIXED_LINKS]
        moving = [geom for geom in arm if self._model.geom_bodyid[geom] not in fixed]
        surroundings = np.flatnonzero(self._model.geom_contype == SURROUNDINGS_BIT).tolist()
        apart = [pair for pair in combinations(arm, 2) if not self._joined(*pair)]
        self._pairs = [*product(moving, surroundings), *apart]

    def __call__(self, q: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n"]:
        """The minimum gap [m] at each row of joint angles [rad]; negative where shapes overlap."""
        return np.array([min(self._distances(row)) for row in q])

    def closest(self, q: Float[np.ndarray, "6"]) -> Closest:
        """The closest pair with the joints at `q` [rad]."""
        distances = self._distances(q)
        nearest = int(np.argmin(distances))
        arm, other = (self._model.geom(geom).name for geom in self._pairs[nearest])
        return Closest(distance=distances[nearest], of_arm=arm, of_other=other)

    def _distances(self, q: Float[np.ndarray, "6"]) -> list[float]:
        """Gaps of all pairs [m]."""
        self._data.qpos[self._joints] = q
        mujoco.mj_kinematics(self._model, self._data)
        return [
            mujoco.mj_geomDistance(self._model, self._data, *pair, MEASURED_UP_TO, None)
            for pair in self._pairs
        ]

    def _joined(self, first: int, second: int) -> bool:
        """Whether one joint at most lies between two shapes of the arm."""
        rigid = self._model.body_weldid[self._model.geom_bodyid[[first, second]]]
        parents = self._model.body_weldid[self._model.body_parentid[rigid]]
        return bool(rigid[0] == rigid[1] or rigid[0] == parents[1] or rigid[1] == parents[0])


def _describe(cell: Cell, with_chest: bool) -> Element:
    root: Element = mjcf.RootElement(model="cell")
    root.compiler.angle = "radian"
    flange = add_arm(root, cell.kinematics)
    chest = [cell.chest] if cell.chest is not None and with_chest else []
    for shape in cell.tool:
        _add(flange, shape, of_arm=True)
    for shape in (*cell.room, *chest):
        _add(root.worldbody, shape, of_arm=False)
    return root


def _add(body: Element, shape: Shape, *, of_arm: bool) -> None:
    try:
        add_collision(
            body, shape.name, of_arm=of_arm, type=shape.kind, size=shape.size, **placed(shape.X)
        )
    except ValueError as error:
        raise ConfigError(
            f"the hull {shape.name} of the cell cannot be used: {error}", shape.name
        ) from error
