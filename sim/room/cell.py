# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The twin's cell: what a robot's file would say of the place that a scene describes."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.cell import Cell
from breastscan.geometry import se3
from breastscan.geometry.hulls import SIZES, Shape
from sim.room.chest import CHEST_HULL
from sim.room.describe import ARM_BIT, SURROUNDINGS_BIT
from sim.scene import Scene
from sim.wrist.probe import payload


def cell_of(scene: Scene) -> Cell:
    """The cell whose arm, tool, cameras and surroundings are the scene's, as far as a user can
    know them.
    """
    model, data = scene.physics, mujoco.MjData(scene.physics)
    mujoco.mj_kinematics(model, data)
    flange = model.body("flange").id
    X_FB = se3.inverse(se3.pose(data.xmat[flange].reshape(3, 3), data.xpos[flange]))
    carried = np.isin(model.geom_bodyid, [flange, model.body("tool").id]) & (
        model.geom_contype == ARM_BIT
    )
    simple = model.geom_type != mujoco.mjtGeom.mjGEOM_MESH  # a curved chest is not
    around = {
        shape.name: shape
        for shape in _shapes(data, (model.geom_contype == SURROUNDINGS_BIT) & simple, np.eye(4))
    }
    return Cell(
        X_FP=scene.X_FP,
        payload=payload(scene.config.mount_angle),
        rig=scene.rig,
        tool=tuple(_shapes(data, carried, X_FB)),
        chest=around.pop(CHEST_HULL, None),
        room=tuple(around.values()),
        kinematics=scene.calibration,
    )


def walled_cell(scene: Scene) -> Cell:
    """The same with the chest among what stands around: for motions that nothing is seen before."""
    cell = cell_of(scene)
    chest = () if cell.chest is None else (cell.chest,)
    return replace(cell, room=(*cell.room, *chest), chest=None)


def _shapes(data: mujoco.MjData, which: np.ndarray, X_AB: Float[np.ndarray, "4 4"]) -> list[Shape]:
    """Some of a model's hulls, placed in A."""
    shapes = []
    for geom in np.flatnonzero(which):
        kind: Any = mujoco.mjtGeom(data.model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        size = tuple(data.model.geom_size[geom][: SIZES[kind]].tolist())
        X = X_AB @ se3.pose(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        shapes.append(Shape(name=data.model.geom(geom).name, kind=kind, size=size, X=X))
    return shapes
