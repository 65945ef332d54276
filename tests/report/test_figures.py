"""Each figure draws the run's own numbers, in the unit that its axis names."""

import re
from pathlib import Path

import numpy as np
import pytest

from breastscan.report import (
    cloud_view,
    contact_figures,
    joint_figures,
    path_figures,
    theme,
    time_figures,
)
from breastscan.run.trajectory import Span, Trajectory
from tests.run.synthetic_run import INDENTATION, SET_POINT, write_run

ROOT = Path(__file__).parents[2]
FULL_COLOUR = (0, 2, 4, 6)
"""PNG's colour types without a palette, at their place in its header."""


@pytest.fixture(scope="session")
def hardware(tmp_path_factory):
    """A log without truth."""
    return Trajectory.load(
        write_run(tmp_path_factory.mktemp("hardware"), with_truth=False) / "trajectory.parquet"
    )


def line(axis, label):
    return next(line for line in axis.lines if line.get_label() == label)


def test_the_planned_loop_passes_through_the_path_points(run):
    top = path_figures.planned_and_executed(run.path_B, run.trajectory).axes[0]
    points_mm, loop_mm = line(top, "path points").get_xydata(), line(top, "planned").get_xydata()
    distances_mm = np.linalg.norm(points_mm[:, None] - loop_mm[None], axis=2).min(axis=1)
    assert distances_mm.max() < 0.05
    assert top.get_aspect() == 1.0


def test_the_drawn_deviation_is_enlarged_by_the_factor_in_its_label(run):
    top = path_figures.planned_and_executed(run.path_B, run.trajectory).axes[0]
    planned_mm, errors_mm = (
        line(top, "planned").get_xydata(),
        run.trajectory.path_errors_mm()[:, :2],
    )
    drawn_mm = line(top, "executed, deviation × 2").get_xydata() - planned_mm
    np.testing.assert_allclose(drawn_mm, 2 * errors_mm, atol=1e-9)


@pytest.mark.parametrize(
    ("deviation", "factor"), [(0.01, 100.0), (0.5, 20.0), (5.0, 2.0), (30.0, 1.0)]
)
def test_deviations_are_enlarged_only_as_far_as_the_loop_stays_recognisable(deviation, factor):
    assert path_figures.magnification(np.array([[deviation, 0.0, 0.0]]), extent=120.0) == factor


def test_deviations_are_drawn_in_millimetres_over_the_path_length(run):
    figure = path_figures.deviations(run.trajectory)
    curve = figure.axes[4].lines[1]
    np.testing.assert_allclose(curve.get_ydata(), run.trajectory.path_errors_mm()[:, 0])
    assert figure.axes[4].get_ylabel() == "x, with the\nindentation [mm]"
    assert curve.get_xdata()[-1] == pytest.approx(1e3 * 2 * np.pi * 0.062, rel=1e-3)


def test_the_part_along_the_normal_is_drawn_as_the_indentation_it_is(run):
    axis = path_figures.deviations(run.trajectory).axes[2]
    assert axis.get_ylabel() == "indentation\n[mm]"
    np.testing.assert_allclose(axis.lines[1].get_ydata(), -run.trajectory.normal_errors_mm())
    assert axis.lines[1].get_ydata().mean() > 0.0, "deeper is positive"


def test_the_histogram_holds_the_whole_loop(run):
    indentation = path_figures.deviations(run.trajectory).axes[3]
    assert sum(bar.get_width() for bar in indentation.patches) == pytest.approx(100.0, abs=1e-6)


@pytest.mark.parametrize(
    ("draw", "measured"), [(joint_figures.joint_angles, "q"), (joint_figures.joint_speeds, "qd")]
)
def test_joints_are_drawn_in_degrees_measured_and_planned(run, draw, measured):
    figure = draw(run.trajectory)
    assert len(figure.axes) == 6
    for joint, axis in enumerate(figure.axes):
        drawn = line(axis, "measured").get_ydata()
        assert np.isin(drawn, np.rad2deg(getattr(run.trajectory, measured)[:, joint])).all()
        assert np.isnan(line(axis, "planned").get_ydata()[0])


def test_bars_show_the_fraction_of_the_speed_limit(run):
    speeds = joint_figures.joint_limits(run.trajectory).axes[1]
    peak_deg_s = np.rad2deg(np.abs(run.trajectory.qd).max(axis=0))
    np.testing.assert_allclose(
        [bar.get_width() for bar in speeds.patches], 100 * peak_deg_s / 180.0
    )


def test_the_force_figure_shows_the_set_point_over_the_loop_and_the_truth(run):
    axis = contact_figures.contact_force(run.trajectory, SET_POINT).axes[0]
    set_point = line(axis, "set-point")
    np.testing.assert_array_equal(set_point.get_ydata(), [SET_POINT, SET_POINT])
    np.testing.assert_allclose(set_point.get_xdata(), [5.0, 21.0], atol=0.01)
    np.testing.assert_array_equal(line(axis, "true").get_ydata(), run.trajectory.true_force)


def test_the_enlarged_force_shows_the_loop_from_one_second_on(run):
    enlarged = contact_figures.contact_force(run.trajectory, SET_POINT).axes[1]
    assert enlarged.get_xlim() == pytest.approx((6.0, 21.0), abs=0.01)
    assert enlarged.get_ylim()[1] - enlarged.get_ylim()[0] < 1.0


def test_no_peak_of_the_measured_force_is_lost(run):
    force = run.trajectory.pressing_force
    _, lowest, highest = contact_figures.envelope(run.trajectory.t, force)
    assert highest.max() == force.max()
    assert lowest.min() == force.min()
    assert len(highest) <= contact_figures.STRETCHES


def test_without_truth_only_what_was_measured_is_drawn(hardware):
    assert not any(axis.lines for axis in contact_figures.contact_force(hardware, None).axes)
    assert contact_figures.indentation(hardware) is None


def test_indentation_is_drawn_in_millimetres(run):
    axis = contact_figures.indentation(run.trajectory).axes[0]
    assert axis.lines[0].get_ydata().max() == pytest.approx(1e3 * INDENTATION, rel=0.01)
    assert axis.get_ylabel() == "indentation [mm]"


@pytest.mark.parametrize("draw", [joint_figures.joint_angles, joint_figures.joint_speeds])
def test_phases_names_meet_neither_each_other_nor_a_curve(run, draw):
    figure = draw(run.trajectory)
    figure.draw_without_rendering()
    axis = figure.axes[0]
    boxes = [text.get_window_extent() for text in axis.texts]
    assert len(boxes) == len(run.trajectory.spans())
    assert not any(
        one.overlaps(other) for number, one in enumerate(boxes) for other in boxes[:number]
    )
    for curve in axis.lines:
        x, y = axis.transData.transform(np.nan_to_num(curve.get_xydata(), nan=-1e6)).T
        for box in boxes:
            assert not ((x > box.x0) & (x < box.x1) & (y > box.y0)).any()


def test_a_name_that_would_meet_the_last_is_left_out(run):
    _, ((axis,),) = theme.panels(1, 1, height_in=2.0)
    axis.plot([0.0, 100.0], [0.0, 1.0])
    short = [Span(phase="search", start=50.0 + k, end=51.0 + k) for k in range(4)]
    spans = [Span(phase="loop", start=0.0, end=50.0), *short]
    theme.shade_phases(axis, [*spans, Span(phase="retreat", start=54.0, end=100.0)])
    assert [text.get_text() for text in axis.texts].count("search") < 4


def test_no_two_members_of_a_family_look_alike_without_colour():
    assert len({look.linestyle for look in theme.FAMILY}) == len(theme.FAMILY)
    assert len({look.marker for look in theme.FAMILY}) == len(theme.FAMILY)


@pytest.mark.parametrize("folder", ["breastscan/report", "experiments"])
def test_every_colour_is_named_in_one_place(folder):
    for path in (ROOT / folder).glob("*.py"):
        found = re.findall(r"#[0-9a-f]{6}\b|[\"']C\d[\"']", path.read_text(encoding="utf-8"))
        assert path.name == "theme.py" or not found, f"{path} states {found}"


@pytest.mark.parametrize("picture", sorted((ROOT / "docs/images").glob("*.png")), ids=str)
def test_no_picture_of_the_docs_is_cut_to_a_palette(picture):
    assert picture.read_bytes()[25] in FULL_COLOUR


def test_figures_are_written_in_full_colour(tmp_path):
    theme.write_png(time_figures.wall_time({"plan": 1.0}), tmp_path / "bars.png")
    assert (tmp_path / "bars.png").read_bytes()[25] in FULL_COLOUR


def test_each_stage_has_a_bar_as_long_as_it_took():
    (axis,) = time_figures.wall_time({"plan": 0.5, "execute": 7.0}).axes
    assert [bar.get_width() for bar in axis.patches] == [0.5, 7.0]


def test_the_cloud_is_drawn_in_millimetres(run):
    skin = cloud_view.figure(run.cloud_B, run.path_B, run.normals_B, run.trajectory).data[0]
    np.testing.assert_allclose(
        np.stack([skin.x, skin.y, skin.z], axis=1), 1e3 * run.cloud_B, rtol=1e-5
    )


def test_drawings_follow_the_pages_colours_and_keep_their_text(run):
    svg = theme.to_svg(
        contact_figures.contact_force(run.trajectory, SET_POINT), 'Force "over" <time>'
    )
    assert "pressing force [N]" in svg
    assert "var(--measured)" in svg
    assert not any(colour in svg for colour in theme.CSS_VARIABLES)
    assert 'aria-label="Force &quot;over&quot; &lt;time&gt;"' in svg


def test_drawings_are_the_same_every_time():
    assert theme.to_svg(time_figures.wall_time({"plan": 1.0}), "") == theme.to_svg(
        time_figures.wall_time({"plan": 1.0}), ""
    )
