"""The smallest gap to the body, held against points by the hundred thousand and MuJoCo's own
distances.
"""

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from breastscan.geometry import kinematics, se3
from sim.room.body_gap import BodyGap
from sim.room.cell import cell_of
from sim.room.chest import CHEST_HULL
from sim.room.describe import ARM_BIT
from sim.scene import HOME_Q
from tests.sim.tissue.press_poses import loop_pose


def joints(scene, X_SP):
    """Angles [rad] with the tip at a pose in the phantom."""
    X_BF = scene.X_BS @ X_SP @ se3.inverse(scene.X_FP)
    solutions = kinematics.inverse(X_BF)
    return solutions[np.abs(solutions - HOME_Q).sum(axis=1).argmin()]


def beside_the_breast(height):
    """X_SP of a probe straight down on the chest plate, its face so high over it [m]."""
    return se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([-0.13, 0.0, height]))


def smallest(scene, q, rise=0.0):
    gap = BodyGap(scene)
    gap.add(q, rise, scene.phantom.skin.vertices_S)
    return gap.smallest


def by_points(scene, X_SP):
    """Gap of the probe's box from the skin between dense points of the one and of the other [m], to
    a tenth of a millimetre; how deep skin lies in the box where it does, below zero.
    """
    rng = np.random.default_rng(0)
    near = scene.phantom.inverse_map(X_SP[None, :3, 3])[0]
    direction = near / np.linalg.norm(near) + 0.5 * rng.standard_normal((60_000, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    skin_S = scene.phantom.embed(direction / np.linalg.norm(direction, axis=1, keepdims=True))
    (box,) = [shape for shape in cell_of(scene).tool if shape.kind == "box"]
    X_SH, half = X_SP @ se3.inverse(scene.X_FP) @ box.X, np.array(box.size)
    depth = (half - np.abs(se3.transform(se3.inverse(X_SH), skin_S))).min(axis=1)
    if depth.max() > 0:
        return -depth.max()
    surface, _ = trimesh.sample.sample_surface(trimesh.creation.box(2 * half), 20_000, seed=0)
    edges = np.linspace(-1.0, 1.0, 200)[:, None] * np.eye(3)[:, None]
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 1, 1, 3)
    edges = np.where(np.eye(3, dtype=bool)[:, None], edges, corners).reshape(-1, 3) * half
    points_S = se3.transform(X_SH, np.vstack([surface, edges]))
    return KDTree(skin_S).query(points_S, distance_upper_bound=0.04)[0].min()


def to_plate(scene, q):
    """MuJoCo's own gap between any hull and the chest plate [m]."""
    model, data = scene.physics, mujoco.MjData(scene.physics)
    data.qpos[:6] = q
    mujoco.mj_kinematics(model, data)
    hulls, chest = np.flatnonzero(model.geom_contype == ARM_BIT), model.geom(CHEST_HULL).id
    return min(mujoco.mj_geomDistance(model, data, hull, chest, 1.0, None) for hull in hulls)


@pytest.mark.parametrize("height", [0.015, 0.002, -0.005, -0.014])
@pytest.mark.parametrize("azimuth", [0.4, 2.5, 4.6])
def test_the_gap_is_that_between_dense_points_of_hull_and_skin(quiet_scene, azimuth, height):
    """Tilted by 25 degrees, so that an edge of the probe is nearest; at the last, it lies in the
    skin.
    """
    tilted = se3.from_rotation_vector(np.array([0.3, 0.35, 0.2]), np.zeros(3))
    X_SP = loop_pose(quiet_scene.phantom, azimuth, -height) @ tilted
    q = joints(quiet_scene, X_SP)
    found = smallest(quiet_scene, q)
    expected = min(by_points(quiet_scene, X_SP), to_plate(quiet_scene, q))
    assert found == pytest.approx(expected, abs=0.3e-3)


def test_the_gap_to_the_plate_is_mujocos_while_nothing_overlaps(quiet_scene):
    """Of links too: the skin is left out of it, far below the plate."""
    q = HOME_Q + np.random.default_rng(0).uniform(-0.5, 0.5, (40, 6))
    far_S = quiet_scene.phantom.skin.vertices_S - [0.0, 0.0, 10.0]
    for row in q:
        gap, expected = BodyGap(quiet_scene), to_plate(quiet_scene, row)
        gap.add(row, 0.0, far_S)
        assert expected > 0
        assert gap.smallest == pytest.approx(expected, abs=1e-3)


def test_a_probe_pushed_into_the_plate_is_negative_by_as_much(quiet_scene):
    """Also 60 mm deep, where `mj_geomDistance` may tell of a gap. The hull begins 10 mm behind the
    face.
    """
    for depth in (0.001, 0.004, 0.02):
        q = joints(quiet_scene, beside_the_breast(-depth - 0.010))
        assert smallest(quiet_scene, q) == pytest.approx(-depth, abs=1e-6)
    assert smallest(quiet_scene, joints(quiet_scene, beside_the_breast(-0.07))) < -0.02


def test_a_chest_that_rises_comes_as_much_nearer(quiet_scene):
    q = joints(quiet_scene, beside_the_breast(0.002))
    assert smallest(quiet_scene, q) == pytest.approx(0.012, abs=1e-6)
    assert smallest(quiet_scene, q, rise=0.005) == pytest.approx(0.007, abs=1e-6)


def test_the_smallest_of_all_poses_is_kept(quiet_scene):
    gap = BodyGap(quiet_scene)
    for height in (0.02, 0.004, 0.03):
        q = joints(quiet_scene, beside_the_breast(height))
        gap.add(q, 0.0, quiet_scene.phantom.skin.vertices_S)
    assert gap.smallest == pytest.approx(0.014, abs=1e-6)
