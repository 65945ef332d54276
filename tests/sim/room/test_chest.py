"""The chest as it is seen, touched and kept clear of, tilted and curved."""

import mujoco
import numpy as np
import pytest

from breastscan.geometry import kinematics, se3
from sim.robot import SimRobot
from sim.room.body_gap import BodyGap
from sim.room.cell import cell_of
from sim.room.chest import CHEST_HULL, chest_block, chest_distance
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.tissue.breathing import BreathingConfig
from sim.tissue.chest import ChestConfig

CHEST = ChestConfig(tilt=0.15, azimuth=1.9, radius=0.2)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(SceneConfig(chest=CHEST, breathing=BreathingConfig(amplitude=0.004)).seeded(0))


def on_chest(scene: Scene, x: float, y: float) -> np.ndarray:
    """The chest's point at a place of S, in S [m]."""
    return np.array([x, y, -scene.phantom.curvature * y**2 / 2])


def joints(scene: Scene, X_SP: np.ndarray) -> np.ndarray:
    """Angles [rad] with the tip at a pose in the phantom."""
    X_BF = scene.X_BS @ X_SP @ se3.inverse(scene.X_FP)
    solutions = kinematics.inverse(X_BF)
    return solutions[np.abs(solutions - HOME_Q).sum(axis=1).argmin()]


def over_chest(scene: Scene, height: float) -> np.ndarray:
    """X_SP of a probe square on the chest beside the breast, its face so high over it [m]."""
    y, bend = 0.12, scene.phantom.curvature
    n_S = np.array([0.0, bend * y, 1.0]) / np.hypot(1.0, bend * y)
    R = np.stack([[1.0, 0, 0], np.cross(-n_S, [1.0, 0, 0]), -n_S], axis=1)
    return se3.pose(R, on_chest(scene, -0.02, y) + height * n_S)


def test_the_drawn_chest_is_the_curved_one(scene):
    """Within .05 mm, along rays down the normal of S beside the breast."""
    model = scene.pictures
    data = mujoco.MjData(model)
    data.qpos[:] = HOME_Q
    mujoco.mj_forward(model, data)
    found = np.zeros(1, np.int32)
    groups = (np.arange(6) == 2).astype(np.uint8)
    for x, y in ((0.10, 0.03), (-0.12, 0.10), (0.0, -0.15), (0.05, 0.11)):
        start_S = on_chest(scene, x, y) + np.array([0.0, 0.0, 0.15])
        start_B = se3.transform(scene.X_BS, start_S)
        away = mujoco.mj_ray(model, data, start_B, -scene.X_BS[:3, 2], groups, 1, -1, found)
        assert away == pytest.approx(0.15, abs=5e-5)


def test_the_drawn_skin_is_the_phantoms(scene):
    model = scene.pictures
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    skin_B = se3.transform(scene.X_BS, scene.phantom.skin.vertices_S)
    np.testing.assert_allclose(data.flexvert_xpos, skin_B, atol=1e-6)


def test_breath_moves_the_chest_along_its_own_normal(scene):
    moved_B = scene.X_BS_at(2.0)[:3, 3] - scene.X_BS[:3, 3]
    np.testing.assert_allclose(moved_B, 0.008 * scene.X_BS[:3, 2], atol=1e-12)
    robot = SimRobot(scene)
    for _ in range(500):
        robot.follow(HOME_Q)
    log = robot.truth_log()
    X_BS = scene.X_BS_at(log.time[-1] - log.time[0])
    X_BP = scene.arm.forward(log.q[-1]) @ scene.X_FP
    np.testing.assert_allclose(log.X_SP[-1], se3.inverse(X_BS) @ X_BP, atol=1e-6)


@pytest.mark.parametrize("height", [0.03, 0.012, 0.005, -0.01])
def test_the_gap_to_a_curved_chest_is_that_of_the_probes_box(scene, height):
    """Square on the chest, the hull's face, 10 mm behind the probe's, lies flat over the cylinder:
    its middle line is nearest.
    """
    gap = BodyGap(scene)
    far_S = scene.phantom.skin.vertices_S - np.array([0.0, 0.0, 10.0])
    gap.add(joints(scene, over_chest(scene, height)), 0.0, far_S)
    assert gap.smallest == pytest.approx(height + 0.010, abs=1e-6)


def test_distances_to_a_curved_chest_are_those_to_dense_points_of_its_surface():
    X_BS, bend = se3.pose(CHEST.R_BS, np.array([0.5, 0.0, 0.08])), CHEST.curvature
    half, depth = chest_block(X_BS, bend)
    x, y = (np.linspace(-length, length, 801) for length in half)
    top = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    top = np.column_stack([top, -bend * top[:, 1] ** 2 / 2])
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.25, -0.3, -0.03], [0.25, 0.3, 0.2], (60, 3))
    above = points[points[:, 2] > -bend * points[:, 1] ** 2 / 2 + 0.002]
    assert len(above) > 30
    for p in above:
        nearest = np.linalg.norm(top - p, axis=1).min()
        assert chest_distance(bend, half, *p) == pytest.approx(nearest, abs=0.1e-3)
    assert depth > 0.08


def test_touching_the_curved_chest_is_logged_with_its_force_along_its_normal(scene):
    """A probe's body that is driven into it square: what the chest does to it points along the
    chest's normal there.
    """
    robot = SimRobot(scene, q=joints(scene, over_chest(scene, 0.02)))
    start, target = robot.state().q, joints(scene, over_chest(scene, -0.0115))
    for part in np.linspace(0.0, 1.0, 400):
        robot.follow(start + part * (target - start))
    log = robot.truth_log()
    touching = np.flatnonzero(log.of_other == CHEST_HULL)
    assert len(touching) > 10
    hardest = touching[log.rigid_force[touching].argmax()]
    force_S = log.chest_S[hardest]
    n_S = -over_chest(scene, 0.0)[:3, 2]
    assert np.degrees(se3.angle_between(force_S[None], n_S[None])[0]) < 30
    assert "touched the chest plate" in (log.touched_else or "")


def test_a_cell_tells_of_simple_hulls_only(scene):
    assert cell_of(scene).chest is None
