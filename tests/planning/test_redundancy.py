"""Roll and tilt along loops around breasts drawn as they differ, on their true skin."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from breastscan.errors import PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.geometry.plane import Plane
from breastscan.planning import motion, probe_poses, redundancy
from breastscan.planning.candidates import Limits
from breastscan.planning.clearance import Body
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.fitting import Fitted, Task, fit
from breastscan.planning.joint_limits import JointPathConfig
from breastscan.planning.pattern import Path
from breastscan.scan import ScanConfig
from sim.room.cell import cell_of
from sim.scene import Scene, SceneConfig
from sim.tissue.breast import SHAPES
from sim.tissue.phantom import Phantom, PhantomConfig

PERIOD = 0.002
FOOT = 2.5e-3
SPACING = 3
JOINTS = JointPathConfig()


@pytest.fixture(scope="module")
def scene():
    return Scene(SceneConfig())


@cache
def drawn(number: int) -> Phantom:
    """One of many breasts: class by class, sizes and sags as the population's."""
    rng = np.random.default_rng(1000 + number)
    low, high = rng.uniform(0.85, 1.15, 2), rng.uniform(0.5, 1.5, 2)
    return Phantom(
        PhantomConfig(
            breast=list(SHAPES)[number % len(SHAPES)],
            size=low[0],
            projection=low[1],
            ptosis=high[0],
            asymmetry=high[1],
            seed=number,
        )
    )


def loop(phantom: Phantom, X_BS: np.ndarray, height: float) -> Path:
    """Fifteen points of its true contour at a height [m], counter-clockwise from the robot on."""
    contour = phantom.level_loop(height, 900)
    contour = np.roll(contour, -int(contour[:, 0].argmin()), axis=0)
    steps = np.linalg.norm(np.diff(contour, axis=0, append=contour[:1]), axis=1)
    s = np.append(0.0, np.cumsum(steps))
    points_S = contour[np.searchsorted(s, s[-1] * np.arange(15) / 15)]
    direction = phantom.inverse_map(points_S)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Path(
        points_B=se3.transform(X_BS, points_S),
        normals_B=se3.rotate(X_BS, phantom.normal(direction)),
    )


def task(scene: Scene, phantom: Phantom, joints: JointPathConfig = JOINTS) -> Task:
    cell, X_BS = cell_of(scene), scene.X_BS
    plate = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=float(X_BS[2, 3]))
    skin_B = se3.transform(X_BS, phantom.skin.vertices_S)
    skin_B = skin_B[plate.heights(skin_B) > FOOT][::SPACING]
    return Task(
        X_FP=cell.X_FP,
        period=PERIOD,
        limits=FeedrateLimits(),
        config=joints,
        clearance=cell.clearance.of(Body(skin_B=skin_B, chest=plate)),
        corrections=ScanConfig().corrections,
    )


def fitted(scene: Scene, number: int, **joints: float) -> tuple[Fitted, Task]:
    phantom = drawn(number)
    asked = task(scene, phantom, JointPathConfig(**joints))
    at = phantom.height / 2
    return fit(lambda rise: loop(phantom, scene.X_BS, at + rise), [0.0, 0.003, 0.006], asked), asked


def body_gap(found: Fitted, asked: Task) -> float:
    """Smallest gap of the tool to the body, pressing, all along the plan [m]."""
    assert asked.clearance is not None
    X_BP = kinematics.forward(found.motion.q[::10]) @ asked.X_FP
    X_BF = probe_poses.retreated(X_BP, -JOINTS.pressed_depth) @ se3.inverse(asked.X_FP)
    touched_B = np.ascontiguousarray(X_BP[:, :3, 3])
    return float(asked.clearance.tool_to_body(X_BF, touched_B, JOINTS.yielding).min())


@pytest.mark.parametrize("number", range(10))
def test_every_breasts_loop_keeps_clear_of_the_body(scene, number):
    found, asked = fitted(scene, number)
    assert body_gap(found, asked) >= JOINTS.body_margin - 1e-4
    assert found.motion.largest_tilt <= JOINTS.largest_tilt
    normals_B = found.path.normals(found.feed.u)
    axes_B = (kinematics.forward(found.motion.q) @ asked.X_FP)[:, :3, 2]
    lean = np.arccos(np.clip(-np.sum(axes_B * normals_B, axis=1), -1.0, 1.0))
    assert lean.max() <= found.motion.largest_tilt + 1e-6


def test_a_flat_breasts_probe_leans_up_no_more_than_allowed_and_says_so(scene):
    """With a margin of 7 mm no roll keeps a small dense breast's probe clear of the chest."""
    found, _ = fitted(scene, 1, body_margin=0.007)
    assert 0.0 < found.motion.largest_tilt <= JOINTS.largest_tilt
    assert found.told is not None
    assert "leans from the normal" in found.told


def test_a_path_moves_up_where_leaning_is_not_allowed(scene):
    found, asked = fitted(scene, 1, body_margin=0.008, largest_tilt=0.0)
    assert found.motion.largest_tilt == 0.0
    assert found.rise > 0.0
    assert found.told is not None
    assert "mm higher" in found.told
    assert body_gap(found, asked) >= 0.008 - 1e-4


def test_a_refusal_names_what_binds_and_what_was_tried(scene):
    with pytest.raises(PlanningError) as refusal:
        fitted(scene, 1, body_margin=0.04)
    told = str(refusal.value)
    assert "nearer to the body than joints.body_margin" in told
    assert "tried in vain: leaning the probe by up to 10 degrees and a path up to 6 mm" in told
    assert "no other place of the phantom within 80 mm helps" in told


def test_a_refusal_names_a_place_that_was_tried_with_success(scene):
    """The breast 20 cm too far: it fits where the refusal says, and did not where it was."""
    phantom = drawn(0)
    asked = task(scene, phantom)
    near = loop(phantom, scene.X_BS, phantom.height / 2)

    def farther(distance: float) -> tuple[Path, Task]:
        X = se3.pose(np.eye(3), np.array([distance, 0.0, 0.0]))
        path = Path(points_B=se3.transform(X, near.points_B), normals_B=near.normals_B)
        assert asked.clearance is not None
        return path, replace(asked, clearance=asked.clearance.with_body_moved(X))

    path, far = farther(0.2)
    with pytest.raises(PlanningError, match="nearer to the robot's base it would fit") as refused:
        fit(lambda rise: path, [0.0], far)
    told = re.search(r"with the phantom (\d+) mm nearer", str(refused.value))
    assert told is not None
    path, nearer = farther(0.2 - int(told[1]) * 1e-3)
    fit(lambda rise: path, [0.0], nearer)


def test_a_smoothed_roll_stays_between_barred_ones(scene):
    """Physics: the array lies along the chest all around a flat breast, so the roll has a corridor
    of a few degrees; an average that leaves it would put the probe's edge on the chest.
    """
    found, asked = fitted(scene, 1)
    faults = _faults_along(found, asked)
    assert not any(faults)


def _faults_along(found: Fitted, asked: Task) -> list[str]:
    chosen = redundancy.resolve(
        found.feed.positions, found.path.normals(found.feed.u), asked.X_FP, PERIOD, asked.config,
        asked.clearance, asked.corrections,
    )  # fmt: skip
    limits = Limits(
        X_FP=asked.X_FP, config=asked.config, clearance=asked.clearance,
        corrections=asked.corrections,
    )  # fmt: skip
    X_BP = chosen.poses(found.feed.positions, found.path.normals(found.feed.u))
    return limits.faults(X_BP[::40], chosen.branch)


def test_a_tilt_takes_the_normals_to_their_mean_and_no_farther():
    rng = np.random.default_rng(0)
    normals_B = rng.standard_normal((50, 3)) + np.array([0.0, 0.0, 3.0])
    normals_B /= np.linalg.norm(normals_B, axis=1, keepdims=True)
    mean_B = normals_B.mean(axis=0)
    tilt = rng.uniform(0.0, 0.3, 50)
    turned_B = probe_poses.tilted(normals_B, mean_B, tilt)
    up_B = mean_B / np.linalg.norm(mean_B)
    before, after = (np.arccos(np.clip(n @ up_B, -1.0, 1.0)) for n in (normals_B, turned_B))
    np.testing.assert_allclose(after, np.maximum(before - tilt, 0.0), atol=1e-7)


def test_motion_without_a_body_needs_no_tilt(scene):
    phantom = drawn(1)
    path = loop(phantom, scene.X_BS, phantom.height / 2)
    planned, _ = motion.plan_motion(
        path, cell_of(scene).X_FP, PERIOD, FeedrateLimits(), JointPathConfig()
    )
    assert planned.largest_tilt == 0.0
