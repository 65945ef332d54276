import numpy as np
import pytest

from breastscan.planning.joint_limits import JointPathConfig
from experiments import joint_walks, paper_loop, study_joints
from sim.wrist.probe import tip_pose


def test_a_domes_normals_point_outwards_about_fifty_degrees_off_vertical():
    path = paper_loop.dome()
    np.testing.assert_allclose(np.linalg.norm(path.normals_B, axis=1), 1.0)
    outwards = path.points_B - path.points_B.mean(axis=0)
    assert np.all(np.sum(outwards[:, :2] * path.normals_B[:, :2], axis=1) > 0)
    tilt_deg = np.degrees(np.arccos(path.normals_B[:, 2]))
    assert 40.0 < tilt_deg.min() < tilt_deg.max() < 65.0


def test_the_dome_of_an_exact_ellipse_has_the_ellipsoids_normals(monkeypatch):
    """Half an ellipsoid with base half axes 70 and 80 mm, as high as the twin's breast, cut at
    half its height.
    """
    a, b = 0.07, 0.08
    h = paper_loop.HEIGHT_FRACTION * np.sqrt(a * b)
    angle = np.linspace(0.0, 2 * np.pi, 15, endpoint=False)
    x, y = np.sqrt(0.75) * a * np.cos(angle), np.sqrt(0.75) * b * np.sin(angle)
    monkeypatch.setattr(paper_loop, "POINTS_B", np.stack([x, y, np.full(15, 0.01)], axis=1))
    expected = np.stack([x / a**2, y / b**2, np.full(15, h / 2 / h**2)], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(paper_loop.dome().normals_B, expected, atol=1e-9)


def test_points_out_of_reach_are_named_with_their_distance():
    config = JointPathConfig(floor=paper_loop.TABLE_HEIGHT + paper_loop.LINK_RADIUS)
    assert paper_loop.unreachable(paper_loop.vertical(), tip_pose(0.0), config) == []
    lost = paper_loop.unreachable(paper_loop.dome(), tip_pose(0.0), config)
    assert any(point.startswith("P10 (") and "mm out of reach" in point for point in lost)


@pytest.fixture(scope="module")
def walk() -> joint_walks.Walk:
    loop = joint_walks.Loop(
        name="paper",
        path=paper_loop.vertical(),
        table_height=paper_loop.TABLE_HEIGHT,
        in_twin=False,
    )
    return joint_walks.walk(loop, 45.0, "free")


def test_the_mujoco_arm_walks_the_papers_loop_as_planned(walk):
    values = study_joints.summary(walk)
    assert values["tracking_peak_deg"] < 0.1
    assert np.max(values["speed_peak_rad_s"]) < 0.1
    assert values["resampled_1ms_jerk_pct"] < 5.0
    assert all(use["fraction"] < 1.0 for use in values["limits"].values())


def test_every_method_keeps_the_chord_error_and_newton_the_fluctuation(walk):
    loop = joint_walks.Loop(
        name="paper", path=paper_loop.vertical(), table_height=0.0, in_twin=False
    )
    rows = {row["method"]: row for row in joint_walks.fluctuations([loop])}
    assert set(rows) == {"taylor1", "taylor2", "newton"}
    assert (
        rows["newton"]["fluctuation_pct"]
        < 1e-6
        < rows["taylor2"]["fluctuation_pct"]
        < rows["taylor1"]["fluctuation_pct"]
    )
    assert all(
        row["chord_error_mm"] < 1e-3 and row["seam_curvature"] < 1e-9 for row in rows.values()
    )
