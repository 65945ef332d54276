import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
import trimesh
from scipy.spatial import ConvexHull, KDTree

from breastscan.commands import plan
from breastscan.errors import BreastScanError, CalibrationError, ConfigError, PlanningError
from breastscan.geometry import kinematics, se3
from breastscan.planning.feedrate import FeedrateLimits
from breastscan.planning.pattern import PatternConfig
from breastscan.run import writing
from breastscan.run.reading import read_path
from breastscan.scan import PlanningConfig
from sim.wrist.probe import tip_pose
from tests.cloud import clouds

CENTRE_B = np.array([0.5, 0.0, 0.08])
RADIUS = 0.075
HEIGHT = 0.055


def dome() -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of half an ellipsoid on a plate at 80 mm."""
    k = np.arange(4000) + 0.5
    z, azimuth = k / len(k), np.pi * (1 + np.sqrt(5)) * k
    unit = np.stack(
        [np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z], axis=1
    )
    axes = np.array([RADIUS, RADIUS, HEIGHT])
    normals = unit / axes
    return CENTRE_B + axes * unit, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def tips(planned) -> np.ndarray:
    """Where the probe's tip goes, in B [m]."""
    return (kinematics.forward(planned.q) @ tip_pose(np.pi / 4))[:, :3, 3]


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "cloud.ply"
    writing.write_cloud(path, *dome())
    return path


def test_a_cloud_becomes_a_loop_at_half_height_with_its_program(tmp_path, cloud):
    planned = plan.plan(cloud, tmp_path, urscript=True)
    heights_mm = 1e3 * (tips(planned)[:, 2] - CENTRE_B[2])
    np.testing.assert_allclose(heights_mm, 1e3 * HEIGHT / 2, atol=0.5)
    ring_mm = 1e3 * np.linalg.norm((tips(planned) - CENTRE_B)[:, :2], axis=1)
    np.testing.assert_allclose(ring_mm, 1e3 * RADIUS * np.sqrt(0.75), atol=0.5)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"path.csv", "trajectory.csv", "trajectory.json", "path.script", "config.json"}


def test_tables_hold_time_joints_and_tool_poses_that_agree(tmp_path, cloud):
    planned = plan.plan(cloud, tmp_path)
    rows = pl.read_csv(tmp_path / "trajectory.csv")
    assert tuple(rows.columns) == plan.COLUMNS
    values = rows.to_numpy()
    np.testing.assert_allclose(np.diff(values[:, 0]), 0.002, atol=1e-9)
    X_BP = se3.from_rotation_vector(values[:, 10:13], values[:, 7:10])
    np.testing.assert_allclose(
        X_BP, kinematics.forward(values[:, 1:7]) @ tip_pose(np.pi / 4), atol=1e-7
    )
    content = json.loads((tmp_path / "trajectory.json").read_text())
    np.testing.assert_allclose(content["rows"], values, atol=1e-9)
    np.testing.assert_allclose(content["q_approach_rad"], planned.q_approach)


def test_the_path_of_a_plan_gives_the_same_plan_again(tmp_path, cloud):
    first = plan.plan(cloud, tmp_path / "first")
    again = plan.plan(tmp_path / "first" / "path.csv", tmp_path / "again")
    np.testing.assert_allclose(tips(again)[::500], tips(first)[::500], atol=1e-6)
    assert not (tmp_path / "again" / "path.script").exists()


def test_the_plate_may_lie_lower_than_the_cloud(tmp_path, cloud):
    planned = plan.plan(cloud, tmp_path, plate_height=0.07)
    np.testing.assert_allclose(tips(planned)[:, 2] * 1e3, 70.0 + 32.5, atol=0.5)


def written(folder, drawn):
    writing.write_cloud(folder / "cloud.ply", drawn.points_B, drawn.normals_B)
    return folder / "cloud.ply"


@pytest.mark.parametrize("chest", [clouds.flat, clouds.cylinder(0.3)])
def test_on_a_chest_that_leans_the_loop_lies_at_half_height_over_it(tmp_path, chest):
    drawn = clouds.cloud(chest, clouds.tilted(np.radians(15.0), 2.5))
    plan.plan(written(tmp_path, drawn), tmp_path / "out")
    points_B = read_path(tmp_path / "out" / "path.csv")[0]
    assert KDTree(drawn.loop_B).query(points_B)[0].max() < 0.5e-3


def test_a_chest_that_is_but_the_rim_is_told(tmp_path, cloud, capsys):
    plan.plan(cloud, tmp_path)
    assert "heights count from the plane through its lower rim" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("centre", "radius", "why"),
    [
        (0.0, 0.012, "borders on skin that was not seen"),
        (0.04, 0.02, "no skin was seen over"),
        (-0.07, 0.06, "no skin was seen over"),
    ],
    ids=["at the top", "across the loop", "a side"],
)
def test_a_hole_that_the_loop_needs_is_refused(tmp_path, centre, radius, why):
    drawn = clouds.cloud()
    away = np.linalg.norm(drawn.along - [centre, 0.0], axis=1)
    with pytest.raises(PlanningError, match=why):
        plan.plan(written(tmp_path, drawn.where(away > radius)), tmp_path / "out")


def test_what_lays_a_path_on_a_cloud_is_refused_for_a_path_that_is_given(tmp_path, cloud):
    plan.plan(cloud, tmp_path / "first")
    path = tmp_path / "first" / "path.csv"
    for options in (
        {"plate_height": 0.07},
        {"planning": PlanningConfig(pattern=PatternConfig(points=20))},
    ):
        with pytest.raises(ConfigError, match="leave them out for a path"):
            plan.plan(path, tmp_path / "out", **options)


def test_a_top_speed_that_other_limits_hide_is_told_with_them(tmp_path, cloud, capsys):
    plan.plan(
        cloud, tmp_path, planning=replace(PlanningConfig(), feedrate=FeedrateLimits(speed=0.2))
    )
    told = capsys.readouterr().out
    assert "planning.feedrate.speed, 200 mm/s, is reached nowhere" in told
    assert "normal_acceleration" in told
    plan.plan(cloud, tmp_path)
    assert "reached nowhere" not in capsys.readouterr().out


def test_the_default_tool_is_the_twins():
    tcp = np.array(plan.TWIN_TCP)
    np.testing.assert_allclose(
        se3.from_rotation_vector(tcp[3:], tcp[:3]), tip_pose(np.pi / 4), atol=1e-7
    )


def table(**changes: list) -> pl.DataFrame:
    columns = {name: [0.0, 0.1, 0.2, 0.3] for name in ("x_m", "y_m", "z_m")}
    columns |= {"nx": [0.0] * 4, "ny": [0.0] * 4, "nz": [1.0] * 4}
    return pl.DataFrame(columns | changes)


@pytest.mark.parametrize(
    ("rows", "error", "why"),
    [
        (table().drop("nz"), ConfigError, "lacks the columns nz"),
        (table(x_m=["a", "b", "c", "d"]), PlanningError, "point 1 of"),
        (table(y_m=[0.0, 0.1, float("inf"), 0.3]), PlanningError, "point 3 of"),
        (table(nz=[1.0, 1.0, 1.0, 2.0]), PlanningError, "point 4 of .* normal of length 1"),
    ],
)
def test_a_path_that_is_none_says_which_point_or_column(tmp_path, rows, error, why):
    rows.write_csv(tmp_path / "path.csv")
    with pytest.raises(error, match=why):
        read_path(tmp_path / "path.csv")


@pytest.mark.parametrize("points", [3, 5])
def test_too_few_or_repeated_points_are_refused(tmp_path, points):
    rows = pl.concat([table()[:3]] * 2)[:points]
    rows.write_csv(tmp_path / "path.csv")
    with pytest.raises(BreastScanError, match="point"):
        plan.plan(tmp_path / "path.csv", tmp_path / "out")


def ring_off_mm(folder) -> float:
    """How far the path in a plan's folder is from the dome's half-height ring, at most."""
    across_B = read_path(folder / "path.csv")[0] - CENTRE_B - [0.0, 0.0, HEIGHT / 2]
    off = np.hypot(np.linalg.norm(across_B[:, :2], axis=1) - RADIUS * np.sqrt(0.75), across_B[:, 2])
    return 1e3 * float(off.max())


def dome_mesh_mm(folder):
    points, _ = dome()
    faces = ConvexHull(points).simplices
    open_ones = np.ptp(points[faces], axis=1).max(axis=1) < 0.02  # not across the foot
    trimesh.Trimesh(1e3 * points, faces[open_ones], process=False).export(folder / "dome.stl")
    return folder / "dome.stl"


def dome_text(folder):
    far = CENTRE_B + np.array([[0.0, 0.0, HEIGHT + 0.01]]) + 1e-3 * np.eye(3)
    np.savetxt(folder / "dome.xyz", np.vstack([dome()[0], far, np.zeros((50, 3))]))
    return folder / "dome.xyz"


@pytest.mark.parametrize(
    ("source", "told"),
    [
        (dome_mesh_mm, ["taken as millimetres"]),
        (dome_text, ["50 of 4053 points are (0, 0, 0)", "3 of 4003 points lie off", "no normals"]),
    ],
)
def test_meshes_and_clouds_of_points_alone_are_planned_on_and_told(tmp_path, capsys, source, told):
    plan.plan(source(tmp_path), tmp_path / "out")
    assert ring_off_mm(tmp_path / "out") < 0.5
    printed = capsys.readouterr().out
    assert [words for words in told if words not in printed] == []


def test_a_plate_that_is_given_needs_no_normals(tmp_path):
    plan.plan(dome_text(tmp_path), tmp_path / "out", plate_height=CENTRE_B[2])
    assert ring_off_mm(tmp_path / "out") < 0.5


@pytest.mark.parametrize("name", ["cloud.las", "half.ply", "empty.xyz", "folder.ply", "camera.xyz"])
def test_what_cannot_be_planned_on_leaves_earlier_results_whole(tmp_path, cloud, name):
    plan.plan(cloud, tmp_path / "out")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    (tmp_path / "folder.ply").mkdir()
    (tmp_path / "cloud.las").write_bytes(b"LASF")
    (tmp_path / "half.ply").write_bytes(cloud.read_bytes()[:9999])
    (tmp_path / "empty.xyz").write_bytes(b"")
    np.savetxt(tmp_path / "camera.xyz", [0.0, 0.0, 0.5] - (dome()[0] - CENTRE_B))
    with pytest.raises(BreastScanError, match=r"expected|save it|give it"):
        plan.plan(tmp_path / name, tmp_path / "out")
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.parametrize("name", ["cloud.ply", "path.csv"])
def test_missing_and_damaged_files_are_named(tmp_path, name):
    with pytest.raises(ConfigError, match="no file at"):
        plan.plan(tmp_path / name, tmp_path / "out")
    (tmp_path / name).write_bytes(b"\x00\x01 nothing of the kind")
    with pytest.raises(ConfigError, match=name):
        plan.plan(tmp_path / name, tmp_path / "out")


def test_a_calibration_that_is_none_stops_the_plan(tmp_path, cloud):
    with pytest.raises(CalibrationError, match=r"calibration\.conf"):
        plan.plan(cloud, tmp_path / "out", calibration=tmp_path / "calibration.conf")
