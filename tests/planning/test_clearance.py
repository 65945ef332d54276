"""Distances of the arm from itself, its room and a body, held against MuJoCo's and plain points."""

import mujoco
import numpy as np
import pytest

from breastscan.geometry import se3
from breastscan.geometry.plane import Plane
from breastscan.planning.clearance import Body
from sim.arm.ur5e import joint_names
from sim.room.cell import cell_of, walled_cell
from sim.room.describe import ARM_BIT, SURROUNDINGS_BIT
from sim.scene import HOME_Q, Scene, SceneConfig

PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)
FAR = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=-9.0)


@pytest.fixture(scope="module")
def scene():
    return Scene(SceneConfig())


@pytest.fixture(scope="module")
def cell(scene):
    return cell_of(scene)


@pytest.fixture(scope="module")
def walled(scene):
    """The cell whose chest counts as one of the room's hulls."""
    return walled_cell(scene)


def dome(count: int = 4000) -> np.ndarray:
    """Points on half a ball of 60 mm in front of the arm."""
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.array([0.5, 0.0, 0.08]) + 0.06 * direction


def test_an_arm_folded_into_itself_is_found(cell):
    """The elbow bent by 170 degrees puts the wrist into the upper arm, far above the table."""
    folded = np.deg2rad([180.0, -90.0, 170.0, 0.0, -90.0, 0.0])
    closest = cell.clearance.closest(folded)
    assert closest.distance < 0
    assert closest.of_arm.startswith("link")
    assert "hull" in closest.of_other


def test_links_that_share_a_joint_do_not_count(walled):
    assert walled.clearance.closest(HOME_Q).distance > 0.02


def test_the_minimum_gap_is_the_closest_pairs(walled):
    clearance = walled.clearance
    q = HOME_Q + np.random.default_rng(0).uniform(-0.4, 0.4, (5, 6))
    np.testing.assert_allclose(clearance(q), [clearance.closest(row).distance for row in q])


def test_gaps_are_mujocos_where_nothing_overlaps(scene, walled):
    """To a quarter of a millimetre: a cylinder's side is 32 lines here."""
    model, data = scene.physics, mujoco.MjData(scene.physics)
    joints = [model.joint(name).qposadr[0] for name in joint_names()]
    around = np.flatnonzero(model.geom_contype == SURROUNDINGS_BIT).tolist()
    bodies = {geom: model.body(model.geom_bodyid[geom]).name for geom in range(model.ngeom)}
    arm = np.flatnonzero(model.geom_contype == ARM_BIT).tolist()
    link = {geom: int(bodies[geom].removeprefix("link")) for geom in arm if "link" in bodies[geom]}
    link |= {geom: 6 for geom in arm if geom not in link}
    pairs = [(a, b) for a in arm for b in arm if link[b] - link[a] > 1]
    pairs += [(a, b) for a in arm for b in around if link[a] > 1]
    compared = 0
    for q in HOME_Q + np.random.default_rng(0).uniform(-1.0, 1.0, (100, 6)):
        data.qpos[joints] = q
        mujoco.mj_kinematics(model, data)
        theirs = min(mujoco.mj_geomDistance(model, data, *pair, 1.0, None) for pair in pairs)
        ours = walled.clearance(q[None])[0]
        assert (ours > 0) == (theirs > 0)
        if ours > 0:
            compared += 1
            assert ours == pytest.approx(theirs, abs=0.25e-3)
    assert compared > 40


def test_an_elbow_under_the_table_never_counts_as_clear(cell):
    rng = np.random.default_rng(1)
    q = HOME_Q + rng.uniform(-1.5, 1.5, (400, 6))
    elbow = cell.kinematics.link_frames(q)[:, 2, :3, 3]
    below = (elbow[:, 2] < -0.02) & (np.abs(elbow[:, 0]) < 0.25) & (np.abs(elbow[:, 1]) < 0.45)
    assert below.sum() > 5
    assert cell.clearance(q[below]).max() < 0


def test_without_a_body_nothing_is_near(cell):
    X_BF = cell.kinematics.forward(HOME_Q[None])
    assert cell.clearance.tool_to_body(X_BF, np.zeros((1, 3)), 0.0)[0] > 0.9
    assert cell.clearance.arm_to_body(HOME_Q[None])[0] > 0.9


@pytest.mark.parametrize("height", [0.03, 0.012, -0.02])
def test_the_tools_gap_to_the_chest_is_the_height_of_its_lowest_point(cell, height):
    """The probe straight down on the plate: its box begins 10 mm behind its face."""
    clearance = cell.clearance.of(Body(skin_B=dome(), chest=PLATE))
    X_BP = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.35, 0.0, 0.08 + height]))
    X_BF = X_BP @ se3.inverse(cell.X_FP)
    gap = clearance.tool_to_body(X_BF[None], X_BP[None, :3, 3], 0.0)[0]
    assert gap == pytest.approx(height + 0.010, abs=1e-9)


def test_the_tools_gap_to_the_skin_is_the_nearest_points(cell):
    """Of its box, by the box's own closed form on every point."""
    skin_B = dome()
    clearance = cell.clearance.of(Body(skin_B=skin_B, chest=FAR))
    (box,) = [hull for hull in cell.tool if hull.kind == "box"]
    rng = np.random.default_rng(3)
    for _ in range(20):
        R = se3.from_rotation_vector(rng.uniform(-0.5, 0.5, 3), np.zeros(3))[:3, :3]
        X_BP = se3.pose(R @ np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.0, 0.145]))
        X_BF = X_BP @ se3.inverse(cell.X_FP)
        beyond = np.abs(se3.transform(se3.inverse(X_BF @ box.X), skin_B)) - box.size
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        expected = (outside + np.minimum(beyond.max(axis=1), 0.0)).min()
        found = clearance.tool_to_body(X_BF[None], X_BP[None, :3, 3], 0.0)[0]
        assert found == pytest.approx(expected, abs=1e-9)


def test_skin_around_the_touched_place_yields_and_does_not_count(cell):
    skin_B = dome()
    clearance = cell.clearance.of(Body(skin_B=skin_B, chest=FAR))
    X_BP = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.0, 0.132]))  # 8 mm deep
    X_BF, touched_B = X_BP @ se3.inverse(cell.X_FP), np.array([[0.5, 0.0, 0.14]])
    strict, yielding = (
        clearance.tool_to_body(X_BF[None], touched_B, radius)[0] for radius in (0.0, 0.03)
    )
    assert strict == pytest.approx(0.002, abs=0.2e-3)
    assert yielding > 0.006


def test_the_chest_counts_no_farther_than_it_is_seen(cell):
    clearance = cell.clearance.of(Body(skin_B=dome(), chest=PLATE))
    X_BP = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.35, 0.0, 0.09]))
    X_BF, nowhere = X_BP @ se3.inverse(cell.X_FP), np.full((1, 3), np.inf)
    assert clearance.tool_to_body(X_BF[None], nowhere, 0.0)[0] < 0.03
    X_BF[0, 3] -= 0.5
    assert clearance.tool_to_body(X_BF[None], nowhere, 0.0)[0] > 0.1


def test_a_body_moved_with_the_tool_keeps_its_gap(cell):
    clearance = cell.clearance.of(Body(skin_B=dome(), chest=PLATE))
    X = se3.from_rotation_vector(np.array([0.0, 0.1, 0.4]), np.array([0.05, -0.1, 0.02]))
    X_BP = se3.pose(np.diag([1.0, -1.0, -1.0]), np.array([0.52, 0.03, 0.15]))
    X_BF, touched_B = X_BP @ se3.inverse(cell.X_FP), X_BP[None, :3, 3]
    before = clearance.tool_to_body(X_BF[None], touched_B, 0.0)
    moved = clearance.with_body_moved(X)
    after = moved.tool_to_body((X @ X_BF)[None], se3.transform(X, touched_B), 0.0)
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_the_arm_itself_counts_against_the_body(cell):
    q = np.deg2rad([0.0, -20.0, 30.0, -100.0, -90.0, 0.0])
    wrist_B = cell.kinematics.link_frames(q[None])[0, 3, :3, 3]
    near = Body(skin_B=dome() - [0.5, 0.0, 0.08] + wrist_B, chest=FAR)
    assert cell.clearance.of(near).arm_to_body(q[None])[0] < 0.0
