"""What the paper prints is held in one file, and that file agrees with itself."""

from importlib import resources

import numpy as np
import pytest

from breastscan.report import paper
from breastscan.report.paper import PUBLISHED
from breastscan.vision.camera import StereoRig
from experiments.paper.item import HEADINGS, ILLUSTRATIONS, Item, column
from sim.scene import Scene

FIGURES = [f"Fig. {number}" for number in range(1, 24)]
TABLES = [f"Table {number}" for number in range(1, 5)]
PRINTED_DIGIT = 0.005
"""Half of the last digit of the paper's statistics [mm]."""


@pytest.fixture(scope="module")
def rig() -> StereoRig:
    return StereoRig.load(str(resources.files("assets") / "rig.yaml"))


def test_every_figure_and_table_and_the_matrix_is_named_once():
    assert sorted(HEADINGS) == sorted([*FIGURES, *TABLES, "Eq. 32"])
    assert len(set(HEADINGS) - set(ILLUSTRATIONS)) == 24


def test_every_heading_has_a_statement():
    for heading in HEADINGS:
        assert len(PUBLISHED["items"][heading]["statement"].split()) > 5, heading


def test_a_heading_that_the_paper_has_not_is_refused():
    with pytest.raises(ValueError, match="the paper has no"):
        Item(
            heading="Fig. 99",
            ours="",
            verdict="agrees",
            why="",
            data={column("a", "b"): np.ones(1)},
        )


@pytest.mark.parametrize(
    ("printed", "recomputed"),
    [("mean_abs_mm", "mean_abs_mm"), ("standard_deviation_mm", "rms_mm")],
)
def test_the_printed_statistics_are_those_of_table_4s_rows(printed, recomputed):
    found_mm = getattr(paper.table4_statistics(), recomputed)
    np.testing.assert_allclose(found_mm, PUBLISHED[printed], atol=PRINTED_DIGIT + 1e-9)


def test_the_largest_mean_error_of_table_4_is_along_z_as_fig_21_says():
    assert np.argmax(paper.table4_statistics().mean_abs_mm) == 2


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_twins_cameras_are_those_of_table_1(rig, side):
    printed, camera = PUBLISHED[f"camera_{side}"], getattr(rig, side)
    K = np.array(printed["K"], float).T
    K[:2, 2] -= 1.0
    K[0, 1] = 0.0
    np.testing.assert_allclose(camera.K, K, atol=1e-9)
    k1, k2, k3 = printed["radial"]
    np.testing.assert_allclose(camera.distortion, [k1, k2, *printed["tangential"], k3], atol=1e-12)


def test_the_twins_rig_is_that_of_table_2(rig):
    printed = PUBLISHED["stereo"]
    U, _, Vt = np.linalg.svd(np.array(printed["R"]).T)
    np.testing.assert_allclose(rig.X_RL[:3, :3], U @ Vt, atol=1e-9)
    np.testing.assert_allclose(1e3 * rig.X_RL[:3, 3], printed["T"], atol=1e-9)


def test_eq_32_is_not_where_the_twins_cameras_stand():
    printed = np.array(PUBLISHED["hand_eye"]["X"])
    assert np.linalg.det(printed[:3, :3]) < 0.97
    assert printed[2, 3] < 0 < Scene().X_BL[2, 3]
