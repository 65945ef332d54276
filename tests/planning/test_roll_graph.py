import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import PlanningError
from breastscan.planning.roll_graph import KNEE_SPEED, ROLL_STEP, ROLLS, SHIFTS, RollGraph, rolled


def graph_of(
    q: np.ndarray, cost: np.ndarray | None = None, largest_step: float = 100.0
) -> RollGraph:
    poses = len(q)
    return RollGraph(
        q=q,
        cost=np.zeros((poses, ROLLS, 8)) if cost is None else cost,
        durations=np.full(poses - 1, 0.5),
        largest_step=largest_step,
    )


def random_angles(poses: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (poses, ROLLS, 8, 6))


def path_motion(q: np.ndarray, rolls: np.ndarray, branch: int) -> float:
    """Integral of v^2 + v^8 / knee^6 along a path of roll indices, over steps of .5 s."""
    angles = q[np.arange(len(q)), rolls % ROLLS, branch]
    speed = np.angle(np.exp(1j * np.diff(angles, axis=0))) / 0.5
    return float(np.sum(speed**2 + speed**8 / KNEE_SPEED**6) * 0.5)


def test_minimum_motion_equals_the_minimum_over_all_paths():
    q, branches = random_angles(3), [0, 5]
    cost = np.full((3, ROLLS, 8), np.inf)
    cost[:, :, branches] = 0.0
    every_path = itertools.product(range(ROLLS), SHIFTS, SHIFTS, branches)
    minimum = min(
        path_motion(q, np.cumsum([start, *shifts]), branch) for start, *shifts, branch in every_path
    )
    rolls, branch = graph_of(q, cost).minimum_motion()
    assert path_motion(q, np.round(rolls / ROLL_STEP).astype(int), branch) == pytest.approx(minimum)


def test_angles_are_compared_across_whole_turns():
    q = np.zeros((2, ROLLS, 8, 6))
    q[0], q[1] = np.pi - 0.01, -np.pi + 0.01
    rolls, _ = graph_of(q, largest_step=0.05).minimum_motion()
    assert len(rolls) == 2


def test_rolls_run_on_past_a_full_rotation_without_a_jump():
    cost = np.full((100, ROLLS, 8), np.inf)
    cost[np.arange(100), np.arange(100) % ROLLS] = 0.0
    rolls, _ = graph_of(np.zeros((100, ROLLS, 8, 6)), cost).minimum_motion()
    np.testing.assert_allclose(np.diff(rolls), ROLL_STEP)


def test_a_gap_in_the_graph_is_named():
    cost = np.zeros((6, ROLLS, 8))
    cost[3] = np.inf
    with pytest.raises(PlanningError, match="from pose 2 to pose 3 of 6"):
        graph_of(random_angles(6), cost).minimum_motion()


def test_a_roll_rotates_about_the_probes_own_axis():
    X_BQ = np.eye(4)
    X_BQ[:3, :3] = Rotation.from_rotvec([0.2, 0.4, -0.1]).as_matrix()
    result = rolled(X_BQ[None], np.array([0.3]))[0]
    np.testing.assert_allclose(result[:3, 2], X_BQ[:3, 2], atol=1e-12)
    expected_x = np.cos(0.3) * X_BQ[:3, 0] + np.sin(0.3) * X_BQ[:3, 1]
    np.testing.assert_allclose(result[:3, 0], expected_x, atol=1e-12)
