"""Every figure and table of the paper is answered, and the numbers of those that a scan answers are
what other ways of reckoning give.
"""

import re

import numpy as np
import polars as pl
import pytest

from experiments import study_paper
from experiments.paper import (
    calibration,
    curve,
    denoising,
    execution,
    hand_eye,
    joints,
    rig_tables,
    stills,
)
from experiments.paper.item import HEADINGS, ILLUSTRATIONS
from sim.tissue.printed import STIFFNESS

VERDICTS = {"agrees", "better", "worse", "not comparable"}


def values(item, name):
    return next(v for column, v in item.data.items() if column.name == name)


@pytest.fixture(scope="module")
def items(calibrated, placed, scan):
    quicker = pytest.MonkeyPatch()
    quicker.setattr(denoising, "REPEATS", 1)
    quicker.setattr(stills, "SIZE_PX", (300, 200))
    found = [
        *curve.items(),
        *joints.items(),
        *calibration.items(calibrated),
        *rig_tables.items(calibrated),
        *hand_eye.items(placed),
        *study_paper.of_perception(scan, 0),
        *execution.items([scan] * 4),
        *stills.items(scan),
    ]
    quicker.undo()
    return {item.heading: item for item in found}


@pytest.fixture(scope="module")
def folder(items, tmp_path_factory):
    place = tmp_path_factory.mktemp("study")
    patched = pytest.MonkeyPatch()
    patched.setattr(study_paper, "measured", lambda seed: iter(items.values()))
    study_paper.run(place, seed=0)
    patched.undo()
    return place


def test_every_item_has_a_statement_a_verdict_and_what_it_rests_on(items):
    assert set(items) == set(HEADINGS)
    for item in items.values():
        assert item.statement
        assert item.ours
        assert item.verdict in VERDICTS
        assert item.why
        assert "nan" not in item.ours


def test_the_page_has_a_part_for_each_and_their_files_lie_beside(folder, items):
    text = (folder / "study.html").read_text(encoding="utf-8")
    assert re.findall("<h2>(.*?)</h2>", text) == ["Overview", *HEADINGS]
    for item in items.values():
        frame = pl.read_parquet(folder / f"{item.stem}.parquet")
        assert frame.shape == pl.read_csv(folder / f"{item.stem}.csv").shape
        assert frame.height > 0
        if item.heading.startswith("Fig."):
            assert (folder / f"{item.stem}.png").stat().st_size > 5000
            assert "<svg" in (folder / f"{item.stem}.svg").read_text(encoding="utf-8")
    assert len(set(items) - set(ILLUSTRATIONS)) == 24


def test_errors_at_the_points_are_those_of_the_rows_of_the_log_nearest_to_them(items, scan):
    went, path = scan.result.trajectory, scan.result.plan.path
    loop = np.flatnonzero(went.in_loop)
    apart = np.linalg.norm(
        1e3 * went.X_BP_plan[loop, None, :3, 3] - 1e3 * path.points_B[None], axis=2
    )
    assert apart.min(axis=0).max() < 0.05
    rows = loop[apart.argmin(axis=0)]
    error_mm = 1e3 * (went.X_BP[rows, :3, 3] - went.X_BP_plan[rows, :3, 3])
    found = np.stack([values(items["Fig. 21"], f"error_{axis}_mm") for axis in "xyz"], axis=1)
    # at the first point and past the last one the loop starts and ends
    np.testing.assert_allclose(found[1:], error_mm[1:], atol=0.02)
    table = pl.DataFrame({column.name: v for column, v in items["Table 4"].data.items()})
    ours = table.filter(pl.col("scan") == scan.name).row(0)[1:]
    np.testing.assert_allclose(ours[:3], np.abs(found).mean(axis=0))
    np.testing.assert_allclose(ours[3:6], np.sqrt((found**2).mean(axis=0)))


def test_an_exact_scan_errs_by_the_silicone_and_little_else(items, scan):
    deviation_mm = np.stack([values(items["Fig. 22"], f"error_{a}_mm") for a in "xyz"], axis=1)
    share_mm = np.stack([values(items["Fig. 22"], f"silicone_{a}_mm") for a in "xyz"], axis=1)
    given_mm = 1e3 * (scan.force / STIFFNESS) ** (2 / 3)
    assert np.linalg.norm(share_mm, axis=1).mean() == pytest.approx(given_mm, rel=0.1)
    assert np.linalg.norm(deviation_mm - share_mm, axis=1).max() < 0.4 * given_mm


def test_clouds_normals_and_heights_are_those_of_the_scans_own_metrics(items, scan):
    metrics = scan.result.metrics
    assert values(items["Fig. 12"], "tilt_deg").mean() == pytest.approx(metrics["normal_mean_deg"])
    refined = list(values(items["Fig. 6"], "map")).index("refined")
    assert values(items["Fig. 6"], "rmse_mm")[refined] < metrics["surface_rmse_mm"] + 0.05
    height_mm = 1e3 * scan.scene.phantom.height / 2
    np.testing.assert_allclose(values(items["Fig. 14"], "height_mm"), height_mm, atol=0.3)


def test_the_joints_walk_at_the_papers_speed_below_the_limit(items):
    speeds = [values(items["Fig. 19"], f"qd{j}_deg_s") for j in range(1, 7)]
    assert np.abs(speeds).max() < 180.0
    fixed = values(items["Fig. 19"], "roll") == "fixed"
    peaks = np.abs(np.array(speeds)[:, fixed]).max(axis=1)
    assert peaks.argmax() == 5
