"""No arm that follows a planned loop runs through itself, its tool or the body."""

import numpy as np
import pytest

from breastscan.commands import plan
from breastscan.geometry import kinematics
from breastscan.run import writing
from sim.wrist.probe import tip_pose
from tests.commands import loops

LEAST = 0.005
"""Gap between arm, tool and body [m], of which at least 10 and 5 mm are asked for."""
ARM = loops.Arm()


def least_gap(planned, skin_B: np.ndarray) -> float:
    q = loops.postures(planned)
    tips_B = (kinematics.forward(q) @ tip_pose(np.pi / 4))[:, :3, 3]
    return min(
        min(ARM.gaps(row, skin_B, tip)) for row, tip in zip(q[::3], tips_B[::3], strict=True)
    )


@pytest.mark.parametrize("seed", [145, 167, 224])
def test_loops_that_the_tool_would_have_run_through_the_arm_on_keep_clear(tmp_path, seed):
    """Of 130 random loops, ten were planned so while nothing was known of the tool."""
    writing.write_path(tmp_path / "path.csv", *loops.path(np.random.default_rng(seed)))
    planned = plan.plan(tmp_path / "path.csv", tmp_path / "out")
    assert least_gap(planned, np.zeros((0, 3))) > LEAST


@pytest.mark.parametrize("seed", [117])
def test_loops_on_random_clouds_keep_clear_of_the_body(tmp_path, seed):
    drawn = loops.cloud(np.random.default_rng(seed))
    writing.write_cloud(tmp_path / "cloud.ply", drawn.points_B, drawn.normals_B)
    planned = plan.plan(tmp_path / "cloud.ply", tmp_path / "out")
    on_breast = np.linalg.norm(drawn.along, axis=1) < 0.07
    assert least_gap(planned, drawn.points_B[on_breast][::4]) > LEAST


def test_a_folded_arm_and_a_tool_in_the_arm_are_found():
    """The check itself: a wrist in the upper arm, and a tool turned back onto the forearm."""
    nowhere = np.zeros((0, 3)), np.zeros(3)
    arm, _, _, _ = ARM.gaps(np.deg2rad([180.0, -90.0, 170.0, 0.0, -90.0, 0.0]), *nowhere)
    assert arm < -0.01
    q = np.deg2rad([0.0, -90.0, 90.0, -90.0, 0.0, 0.0])
    angles = np.linspace(-np.pi, np.pi, 25)
    postures = [q + np.array([0, 0, 0, a, b, 0]) for a in angles for b in angles[::3]]
    assert min(ARM.gaps(row, *nowhere)[1] for row in postures) < 0.0
