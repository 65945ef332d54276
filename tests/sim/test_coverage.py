"""What an examination is said to have covered, against presses whose patches are known."""

import numpy as np
import pytest

from breastscan.geometry import se3
from breastscan.planning.coverage import CoverageConfig
from breastscan.planning.pattern import PatternConfig
from breastscan.scan import PlanningConfig, ScanConfig, scan
from sim import SceneConfig, Twin
from sim.coverage import Touched

WIDE = CoverageConfig(nipple_margin=0.035, base_margin=0.022)
"""Margins that leave room for a few strokes."""


@pytest.fixture(scope="module")
def examined():
    """A few loops around the flank, executed and measured."""
    planning = PlanningConfig(pattern=PatternConfig(kind="loops"), coverage=WIDE)
    with Twin(SceneConfig(), seed=0) as twin:
        result = scan(twin.robot, twin.camera, twin.cell, ScanConfig(planning=planning))
        return twin, twin.measured(result)


def test_loops_touch_what_lies_between_the_margins_but_near_the_chest(examined):
    _, result = examined
    metrics = result.metrics
    assert len(result.plan.strokes) >= 2
    assert metrics["contact_fraction"] == 1.0
    assert metrics["force_rmse_n"] < 0.15
    assert metrics["force_peak_n"] < 6.5
    assert metrics["coverage_skin_pct"] > 95.0
    assert metrics["coverage_volume_pct"] > 95.0
    assert metrics["coverage_gap_mm2"].get("missed", 0.0) < 30.0
    assert set(metrics["coverage_gap_mm2"]) <= {"missed", "near the chest", "near the nipple"}
    assert "executed_truth_rms_mm" not in metrics  # there is no one loop to hold it against
    assert metrics["clearance_body_min_mm"] > 2.0


def test_the_map_says_point_by_point_what_the_shares_say(examined):
    twin, result = examined
    skin, areas = result.skin_map, twin.tissue.skin_areas
    for name, strokes in (("coverage_skin_pct", 1), ("coverage_twice_pct", 2)):
        touched = areas[skin.wanted & (skin.strokes >= strokes)].sum() / areas[skin.wanted].sum()
        assert result.metrics[name] == pytest.approx(100 * touched)
    low = skin.points_B[:, 2] - twin.scene.X_BS[2, 3] < WIDE.base_margin
    assert not skin.wanted[low].any()


def test_every_stroke_is_tared_and_touched_for_by_itself(examined):
    _, result = examined
    phases = [span.phase for span in result.trajectory.spans()]
    assert phases.count("approach") == phases.count("retreat") == len(result.plan.strokes)
    tilts = np.degrees(result.trajectory.true_tilt[result.trajectory.in_loop])
    assert np.nanmean(tilts) < 1.0


def test_a_press_touches_a_patch_of_its_size_and_sees_under_it(examined):
    """One press at half height: 33 x 12 mm, within a spacing of the skin's points."""
    twin, result = examined
    touched = Touched(twin.scene.phantom, twin.tissue, np.array([1.0]))
    loop_S = twin.truth.level_loop()
    p_S = loop_S[:1]
    _, n_S = twin.truth.closest(p_S)
    up = np.cross(n_S[0], np.cross([0.0, 0.0, 1.0], n_S[0]))
    x_S = np.cross(up / np.linalg.norm(up), -n_S[0])
    R_SP = np.column_stack([x_S, np.cross(-n_S[0], x_S), -n_S[0]])
    twin.tissue.reset()
    X_SP = se3.pose(R_SP, p_S[0] - 0.0055 * n_S[0])
    twin.tissue.press(X_SP, np.zeros(3))
    touched.add(0.5, X_SP)
    loaded = twin.tissue.touched
    across = (twin.tissue.skin_points_S[loaded] - p_S[0]) @ R_SP
    twin.tissue.reset()
    assert 26.0 < np.ptp(across[:, 0]) * 1e3 < 38.0
    assert 9.0 < np.ptp(across[:, 1]) * 1e3 < 16.0
    coverage = result.plan.coverage
    assert coverage is not None
    once = touched.metrics(coverage, twin.scene.X_BS)
    area = twin.tissue.skin_areas[loaded].sum() * 1e6
    assert 250.0 < area < 500.0
    assert once["coverage_twice_pct"] == 0.0
    assert 0.0 < once["coverage_skin_pct"] < 6.0
    assert 0.0 < once["coverage_volume_pct"] < 10.0


def test_skin_outside_of_the_band_is_told_apart_from_what_was_missed(examined):
    twin, result = examined
    coverage = result.plan.coverage
    assert coverage is not None
    azimuth = np.linspace(0.0, 6.0, 7)
    band = coverage.band
    inside = band.path(coverage.tracks[0]).points_B[:7]
    np.testing.assert_array_equal(coverage.why_not(inside), np.full(7, "missed"))
    foot_S = twin.scene.phantom.embed(
        np.column_stack([np.cos(azimuth), np.sin(azimuth), np.full(7, 0.05)])
        / np.sqrt(1.0 + 0.05**2)
    )
    near_chest = coverage.why_not(se3.transform(twin.scene.X_BS, foot_S))
    assert set(near_chest.tolist()) <= {"near the chest", "not seen"}
