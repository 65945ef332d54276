"""The tool of which only the tip is known, against the twin's own and against plain geometry."""

import numpy as np
import pytest
import trimesh

from breastscan.geometry import se3
from breastscan.geometry.hulls import KINDS, Shape, placed_distance
from breastscan.geometry.tool_hulls import FACE, tool_hulls
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig

TIPS = {
    "straight": se3.pose(np.eye(3), np.array([0.0, 0.0, 0.2])),
    "beside the axis": se3.pose(np.eye(3), np.array([0.0, 0.05, 0.2])),
    "square to it": se3.from_rotation_vector(np.array([0, np.pi / 2, 0]), np.array([0.1, 0, 0.08])),
    "skew": se3.from_rotation_vector(np.array([0.4, 0.9, 0.2]), np.array([0.09, 0.03, 0.17])),
    "short": se3.pose(np.eye(3), np.array([0.0, 0.0, 0.05])),
}


def distance(shape: Shape, p_F: np.ndarray) -> float:
    size = np.array([*shape.size, 0.0, 0.0])[:3]
    return float(placed_distance(KINDS.index(shape.kind), size, shape.X, *p_F))


def test_of_the_twins_tool_hardly_anything_stands_out():
    """Its sensor's rim at the flange, by 12 mm into what the arm's last hull covers, and its
    probe by less.
    """
    cell = cell_of(Scene(SceneConfig()))
    own = tool_hulls(cell.X_FP)
    made = {"box": lambda s: trimesh.creation.box(2 * np.array(s)),
            "cylinder": lambda s: trimesh.creation.cylinder(s[0], 2 * s[1])}  # fmt: skip
    for shape in cell.tool:
        points = trimesh.sample.sample_surface(made[shape.kind](shape.size), 1000, seed=0)[0]
        out = [min(distance(h, p) for h in own) for p in se3.transform(shape.X, points)]
        assert max(out) < (0.018 if shape.kind == "cylinder" else 0.002)


@pytest.mark.parametrize("name", TIPS)
def test_it_reaches_from_the_flange_to_behind_the_face(name):
    X_FP = TIPS[name]
    hulls = tool_hulls(X_FP)
    tip_F, axis_F = X_FP[:3, 3], X_FP[:3, 2]
    assert min(distance(h, tip_F) for h in hulls) == pytest.approx(FACE, abs=1e-9)
    assert min(distance(h, tip_F - (FACE + 1e-3) * axis_F) for h in hulls) < 0
    assert distance(hulls[1], np.array([0.0, 0.0, 0.009])) < 0
    along = np.linspace(0.0, 1.0, 50)[:, None]
    ends = [h.X[:3, 3] for h in hulls]
    gap = [min(distance(h, p) for h in hulls) for p in ends[0] + along * (ends[1] - ends[0])]
    assert max(gap) < 0.01
